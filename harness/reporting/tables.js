// Tables that a reader sorts and filters, in reports and in pages of harness view: a button in a heading sorts by its
// column, a search field before a table keeps the rows that hold its text. Both are found by what is clicked, so a
// table may come later than this script, and stand in a shadow root.

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

// The rows of a table as they first stood.
const first = new WeakMap();
const rowsOf = (body) => {
  if (!first.has(body)) first.set(body, groups(body));
  return first.get(body);
};

document.addEventListener("click", (event) => {
  const head = event.composedPath()[0].closest?.("th button")?.closest("th");
  if (!head) return;
  const body = head.closest("table").tBodies[0], all = rowsOf(body);
  const was = head.getAttribute("aria-sort");
  for (const other of head.parentElement.cells) other.removeAttribute("aria-sort");
  const next = was === "ascending" ? "descending" : was ? "" : "ascending";
  if (next) head.setAttribute("aria-sort", next);
  body.append(...(next ? [...all].sort(order(head.cellIndex, next === "descending")) : all).flat());
});

document.addEventListener("input", (event) => {
  const field = event.composedPath()[0];
  const body = field.matches?.("input[type=search]") && field.closest(".tools")?.nextElementSibling?.querySelector("tbody");
  if (!body) return;
  const wanted = field.value.toLowerCase();
  for (const rows of rowsOf(body)) {
    const there = rows.some((row) => row.textContent.toLowerCase().includes(wanted));
    for (const row of rows) row.hidden = !there;
  }
});
