// A list of choices opens where its field gets the focus and closes where that loses it. A browser that lets the
// tabulator stop at whatever rolls would stop at the list, which then closes: the focus falls back to before the field,
// and no key leads any further. Its entries are reached by the arrows.
document.addEventListener("focusin", (event) => {
  const field = event.composedPath().find((node) => node.classList?.contains("choices"));
  for (const list of field?.querySelectorAll(".choices__list--dropdown .choices__list") ?? []) list.tabIndex = -1;
});
