// Series of the figures on and off; buttons and fields that sort and filter tables (tables.js). Everything else of a
// report works without this.

const make = (tag, settings, ...children) => {
  const element = Object.assign(document.createElement(tag), settings);
  element.append(...children);
  return element;
};

const hidden = new Set();
const switches = [];

const show = () => {
  for (const mark of document.querySelectorAll("[data-series]"))
    mark.style.display = hidden.has(mark.dataset.series) ? "none" : "";
  for (const box of switches) box.checked = !hidden.has(box.value);
};

for (const svg of document.querySelectorAll("figure svg")) {
  const names = [...new Set([...svg.querySelectorAll("[data-series]")].map((mark) => mark.dataset.series))];
  if (names.length < 2) continue;
  const boxes = names.map((name) => {
    const box = make("input", { type: "checkbox", value: name, checked: true });
    box.addEventListener("change", () => {
      box.checked ? hidden.delete(name) : hidden.add(name);
      show();
    });
    switches.push(box);
    return make("label", {}, box, ` ${name}`);
  });
  svg.before(make("fieldset", { className: "tools" }, make("legend", { textContent: "shown in all figures" }), ...boxes));
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
