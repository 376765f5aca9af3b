// Series of the figures on and off and the scale of their axes (axes.js); buttons and fields that sort and filter tables
// (tables.js). Everything else of a report works without this.

const make = (tag, settings, ...children) => {
  const element = Object.assign(document.createElement(tag), settings);
  element.append(...children);
  return element;
};

const switches = [];

const show = () => {
  for (const mark of document.querySelectorAll("[data-series]"))
    mark.style.display = hidden.has(mark.dataset.series) ? "none" : "";
  for (const box of switches) box.checked = !hidden.has(box.value);
  axes.forEach(draw);
};

const checkBox = (text, settings, act) => {
  const box = make("input", { type: "checkbox", ...settings });
  box.addEventListener("change", () => act(box.checked));
  return make("label", {}, box, ` ${text}`);
};

for (const svg of document.querySelectorAll("figure svg")) {
  const names = [...new Set([...svg.querySelectorAll("[data-series]")].map((mark) => mark.dataset.series))];
  if (names.length > 1) {
    const boxes = names.map((name) =>
      checkBox(name, { value: name, checked: true }, (shown) => {
        shown ? hidden.delete(name) : hidden.add(name);
        show();
      }),
    );
    switches.push(...boxes.map((label) => label.firstChild));
    svg.before(make("fieldset", { className: "tools" }, make("legend", { textContent: "shown in all figures" }), ...boxes));
  }
  const own = axes.filter(({ figure }) => figure === svg);
  if (!own.length) continue;
  const scale = checkBox("logarithmic axis", { checked: own.some(({ log }) => log) }, (log) => {
    for (const axis of own) axis.log = log;
    own.forEach(draw);
  });
  svg.before(make("div", { className: "tools" }, scale));
}

for (const table of document.querySelectorAll(".sheet table")) {
  const rows = table.tBodies[0] ? groups(table.tBodies[0]).length : 0;
  if (rows < 3 || !table.tHead) continue;
  for (const head of table.tHead.rows[0].cells)
    if (head.textContent.trim()) head.replaceChildren(make("button", { type: "button", title: "sort" }, ...head.childNodes));
  if (rows < 9) continue;
  const field = make("input", { type: "search" });
  table.closest(".sheet").before(make("div", { className: "tools" }, make("label", {}, "rows with ", field)));
}
