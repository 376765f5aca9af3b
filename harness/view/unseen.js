// A figure out of sight is not painted until it comes near: of the twenty of a run three are seen, and the browser
// would spend most of a click, and of a step of a slider, on the others.
const watched = new WeakMap();
const hold = (view, held) => view.model.setv({hold_render: held}, {sync: false}); // a matter of the browser alone
const sight = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    const view = watched.get(entry.target);
    if (view) hold(view, !entry.isIntersecting);
  }
}, {rootMargin: "400px 0px"});
const figures = function* (views) {
  for (const view of views) {
    if (view.model.type === "Figure") yield view;
    else if (view.child_views) yield* figures(view.child_views);
  }
};
const shown = () => [...(window.Bokeh?.index?.roots ?? [])];

// Figures come and go with what is chosen, and nothing tells of it. Each is painted once before it may be held.
setInterval(() => {
  for (const view of figures(shown())) {
    if (watched.get(view.el) === view || !view.has_finished()) continue;
    watched.set(view.el, view);
    sight.observe(view.el);
  }
}, 500);
window.addEventListener("beforeprint", () => { for (const view of figures(shown())) hold(view, false); });
