// Draws the vehicle at the time of the slider. All that is drawn is a number; frame of the first body, x forward, y left.
const d = frames.data, n = d.time.length;
if (n === 0) return;
const g = JSON.parse(geometry.data.json[0]);
const [ahead, own] = g.coupling || [0, 0];
let i = Math.round((slider.value - d.time[0]) / (n > 1 ? d.time[1] - d.time[0] : 1));
i = Math.max(0, Math.min(n - 1, i));
const turned = (x, y, a) => [x * Math.cos(a) - y * Math.sin(a), x * Math.sin(a) + y * Math.cos(a)];
// From the axes of a body to those of the first: the second one hangs on the coupling, turned by theta.
const at = (body, x, y, theta) => {
    if (body === 0) return [x, y];
    const [u, v] = turned(x - own, y, theta);
    return [ahead + u, v];
};
const articulation = g.coupling ? d.articulation[i] : 0;
const angle_of = (body, theta) => (body === 0 ? 0 : theta);
const outline = (body, theta) => {
    const o = g.outlines[body], w = o.width / 2, c = body === 0 ? 0.25 * w : 0;
    const corners = [[o.back, -w], [o.front - c, -w], [o.front, -w + c], [o.front, w - c], [o.front - c, w], [o.back, w]];
    const placed = corners.map(([x, y]) => at(body, x, y, theta));
    return [placed.map((p) => p[0]), placed.map((p) => p[1])];
};
const arrows = () => ({x0: [], y0: [], x1: [], y1: [], angle: [], colour: [], who: []});
const add = (to, [x, y], direction, length, colour, who) => {
    if (!Number.isFinite(direction) || !Number.isFinite(length) || length === 0) return;
    const [u, v] = turned(length, 0, direction);
    to.x0.push(x); to.y0.push(y); to.x1.push(x + u); to.y1.push(y + v);
    to.angle.push(Math.atan2(v, u) - Math.PI / 2); to.colour.push(colour); to.who.push(who);
};
const shapes = {xs: [], ys: [], dash: []}, seen = {xs: [], ys: []}, ghosts = {xs: [], ys: [], colour: [], who: []};
const [here_x, here_y, here_angle] = [d.x[i], d.y[i], d.heading[i]];
g.outlines.forEach((o, body) => {
    const [xs, ys] = outline(body, articulation);
    shapes.xs.push(xs); shapes.ys.push(ys); shapes.dash.push(o.stated ? 'solid' : 'dashed');
    const placed = xs.map((x, k) => turned(x, ys[k], here_angle));
    seen.xs.push(placed.map((p) => here_x + p[0])); seen.ys.push(placed.map((p) => here_y + p[1]));
});
g.estimators.forEach((e, k) => {
    const theta = g.coupling ? d[`articulation ${k}`][i] : NaN;
    if (!Number.isFinite(theta)) return;
    const [xs, ys] = outline(1, theta);
    ghosts.xs.push([...xs, xs[0]]); ghosts.ys.push([...ys, ys[0]]);
    ghosts.colour.push(e.colour); ghosts.who.push(e.name);
});
const wheels = {xs: [], ys: [], use: [], axle: []}, slips = arrows(), planes = arrows(), forces = arrows(), moving = arrows();
const size = g.wheel, reach = g.reach;
const rows = [], told = [];
const shown = (value, scale, digits) => (Number.isFinite(value) ? (scale * value).toFixed(digits).replace('-', '−') : '–');
g.axles.forEach((a, k) => {
    const slip = d[`slip ${k}`][i], force = d[`force ${k}`][i], load = d[`load ${k}`][i], use = d[`use ${k}`][i];
    const direction = angle_of(a.body, articulation) + d[`steer ${k}`][i];
    const half = g.outlines[a.body].width / 2 - 0.15 * size;
    for (const y of a.y === 0 ? [-half, half] : [a.y]) {
        const [x0, y0] = at(a.body, a.x, y, articulation);
        const corners = [[-0.5, -0.15], [0.5, -0.15], [0.5, 0.15], [-0.5, 0.15]].map(([u, v]) => turned(u * size, v * size, direction));
        wheels.xs.push(corners.map((p) => x0 + p[0])); wheels.ys.push(corners.map((p) => y0 + p[1]));
        wheels.use.push(use); wheels.axle.push(a.name);
    }
    const centre = at(a.body, a.x, a.y, articulation);
    add(planes, centre, Number.isFinite(slip) ? direction : NaN, reach, '#777777', a.name);
    add(slips, centre, direction - g.magnified * slip, reach, '#0072B2', a.name);
    add(forces, centre, direction + Math.PI / 2, reach * 1.6 * force / g.force, '#B04A00', a.name);
    rows.push([a.name, shown(slip, 180 / Math.PI, 2), shown(force, 1e-3, 2), shown(load, 1e-3, 1), shown(use, 100, 0)]);
});
const tell = (what, who, value) => {
    if (Number.isFinite(value)) told.push([what, who, shown(value, 180 / Math.PI, 2)]);
};
if (g.coupling) {
    tell('articulation angle', 'truth', articulation);
    g.estimators.forEach((e, k) => tell('articulation angle', e.name, d[`articulation ${k}`][i]));
}
g.outlines.forEach((o, body) => {
    const [cog, what] = [at(body, 0, 0, articulation), `sideslip angle${o.name ? ', ' + o.name : ''}`];
    const direction = angle_of(body, articulation);
    add(moving, cog, direction + g.magnified * d[`sideslip ${body}`][i], 2 * reach, '#000000', 'truth');
    tell(what, 'truth', d[`sideslip ${body}`][i]);
    g.estimators.forEach((e, k) => {
        const found = d[`sideslip ${body} ${k}`][i];
        add(moving, cog, direction + g.magnified * found, 2 * reach, e.colour, e.name);
        tell(what, e.name, found);
    });
});
const track = {x: [], y: []};
for (let k = 0; k < n; k++) {
    const [x, y] = turned(d.x[k] - here_x, d.y[k] - here_y, -here_angle);
    track.x.push(x); track.y.push(y);
}
// Names come out of a study or a vehicle: they are text, never code.
const text = (value) => String(value).replace(/[&<>"']/g, (c) => `&#${c.charCodeAt(0)};`);
const table = (name, head, lines) => `<table class="${name}" style="border-collapse: collapse; margin: 4px 24px 4px 0; font-size: 13px; overflow-wrap: normal">` +
    [head, ...lines].map((line, k) => '<tr>' + line.map((cell, j) => {
        const tag = k === 0 ? 'th' : 'td', side = j === 0 || k === 0 && j === 0 ? 'left' : 'right';
        return `<${tag} style="padding: 2px 10px 2px 0; text-align: ${side}; border-bottom: 1px solid #ccc">${text(cell)}</${tag}>`;
    }).join('') + '</tr>').join('') + '</table>';
numbers.text = '<div style="display: flex; flex-wrap: wrap; align-items: start">' +
    table('axles', ['axle', 'slip angle in °', 'lateral force in kN', 'vertical load in kN', 'friction use in %'], rows) +
    table('angles', ['angle', 'of', 'in °'], told) + '</div>';
for (const [source, data] of [[sources.shapes, shapes], [sources.seen, seen], [sources.ghosts, ghosts], [sources.wheels, wheels],
    [sources.slips, slips], [sources.planes, planes], [sources.forces, forces], [sources.moving, moving],
    [sources.track, track],
    [sources.here, {x: [here_x], y: [here_y], t: [d.time[i]]}], [cursor, {t: [d.time[i]]}]]) { source.data = data; source.change.emit(); }
