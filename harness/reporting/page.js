"use strict";
// Series of the figures on and off; tables sorted and filtered. Everything else of a report works without this.

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

// The first number of a cell: 1.30 of "1.30 to 1.35", 0.001 of "< 0.001", 4500 of "4.5·10³".
const value = (cell) => {
  const text = cell.replaceAll("−", "-").split("\n")[0];
  const found = text.match(/-?\d+(?:\.\d+)?(?:e-?\d+)?/);
  if (!found) return NaN;
  const raised = text.match(/·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/);
  const exponent = raised ? [...raised[1]].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c)).map((k) => (k ? k - 1 : "-")).join("") : 0;
  return Number(`${Number(found[0])}e${exponent}`);
};

// Rows with an empty first cell belong to the row above them and move with it.
const groups = (body) => {
  const found = [];
  for (const row of body.rows)
    if (found.length && !row.cells[0].textContent) found.at(-1).push(row);
    else found.push([row]);
  return found;
};

const order = (column, falling) => (one, other) => {
  const [a, b] = [one, other].map((rows) => rows[0].cells[column]?.textContent ?? "");
  const [x, y] = [value(a), value(b)];
  if (isNaN(x) !== isNaN(y)) return isNaN(x) ? 1 : -1; // what has no number comes last, whichever way
  return (falling ? -1 : 1) * (isNaN(x) ? a.localeCompare(b) : x - y);
};

for (const table of document.querySelectorAll(".sheet table")) {
  const body = table.tBodies[0];
  const all = body ? groups(body) : [];
  if (all.length < 3 || !table.tHead) continue;
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    if (!head.textContent.trim()) return;
    const button = make("button", { type: "button", title: "sort" }, ...head.childNodes);
    button.addEventListener("click", () => {
      const was = head.getAttribute("aria-sort");
      for (const other of heads) other.removeAttribute("aria-sort");
      const next = was === "ascending" ? "descending" : was ? "" : "ascending";
      if (next) head.setAttribute("aria-sort", next);
      const sorted = next ? [...all].sort(order(column, next === "descending")) : all;
      body.append(...sorted.flat());
    });
    head.replaceChildren(button);
  });
  if (all.length < 9) continue;
  const field = make("input", { type: "search" });
  field.addEventListener("input", () => {
    const wanted = field.value.toLowerCase();
    for (const rows of all) {
      const there = rows.some((row) => row.textContent.toLowerCase().includes(wanted));
      for (const row of rows) row.hidden = !there;
    }
  });
  table.closest(".sheet").before(make("div", { className: "tools" }, make("label", {}, "rows with ", field)));
}
