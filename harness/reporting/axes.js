// The axes of errors of the figures: linear or logarithmic, and as long as what is shown needs.

const hidden = new Set(); // names of the series that are switched off
const PAIR = /(-?[\d.]+) (-?[\d.]+)/g; // coordinates in a path

// Each says which of its values is where in the drawing, so that the numbers behind the marks are known.
const axes = [...document.querySelectorAll("[data-axis]")].map((element) => {
  const [scale, ...ends] = element.dataset.axis.split(" ");
  const [low, high, bottom, top] = ends.map(Number);
  const value = (y) => {
    const share = (y - bottom) / (top - bottom);
    if (share >= 1) return Infinity;
    return scale === "log" ? low * (high / low) ** share : low + share * (high - low);
  };
  const marks = [...element.parentNode.querySelectorAll("title")].flatMap((title) =>
    [...title.parentNode.querySelectorAll("path:not(defs *), use[y]")].map((part) => {
      const path = part.getAttribute("d");
      const pairs = path ? [...path.matchAll(PAIR)].map((found) => Number(found[2])) : [Number(part.getAttribute("y"))];
      return { part, path, values: pairs.map(value), series: title.parentNode.dataset.series };
    }),
  );
  const [start, , end] = element.querySelector("path")?.getAttribute("d").match(/-?[\d.]+/g) ?? [];
  const figure = element.closest("svg");
  return { element, figure, ends: `${low} ${high}`, log: scale === "log", bottom, top, marks, start, end };
});

const ticks = (low, high, log) => {
  const found = [];
  if (log)
    for (let k = Math.floor(Math.log10(low)); 10 ** k <= high; k++)
      for (const part of high / low < 540 ? [1, 2, 5] : [1]) found.push(Number(`${part}e${k}`));
  else {
    const size = 10 ** Math.floor(Math.log10(high / 5));
    const step = [1, 2, 5, 10].map((part) => part * size).find((part) => part >= high / 6);
    for (let k = 0; k * step <= high; k++) found.push(Number((k * step).toPrecision(9)));
  }
  return found.filter((tick) => tick >= low && tick <= high);
};

// Panels of a figure with the same ends, those of one target, keep them in common.
const draw = ({ element, figure, ends, log, bottom, top, marks, start, end }) => {
  const shown = axes
    .filter((other) => other.figure === figure && other.ends === ends)
    .flatMap((other) => other.marks.filter(({ series }) => !hidden.has(series)))
    .flatMap(({ values }) => values.filter((value) => value > 0 && value < Infinity));
  if (!shown.length) return;
  const least = shown.reduce((a, b) => Math.min(a, b)), most = shown.reduce((a, b) => Math.max(a, b));
  const [low, high] = log ? [0.75 * least, 1.35 * most] : [0, 1.05 * most];
  const place = (value) => {
    const share = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    return (bottom + Math.min(Math.max(share, -1), 1) * (top - bottom)).toFixed(3);
  };
  for (const { part, path, values } of marks) {
    let next = 0;
    if (path) part.setAttribute("d", path.replace(PAIR, (_, x) => `${x} ${place(values[next++])}`));
    else part.setAttribute("y", place(values[0]));
  }
  const drawn = ticks(low, high, log).map((tick) => [tick, place(tick)]);
  element.innerHTML =
    drawn.map(([, y]) => `<path d="M ${start} ${y} H ${end}" stroke="#d8d8d8" stroke-width="0.4"/>`).join("") +
    drawn.map(([tick, y]) => `<text x="${start - 5}" y="${y}" dy="3" text-anchor="end">${tick}</text>`).join("") +
    element.lastElementChild.outerHTML; // its label
};
