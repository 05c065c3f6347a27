// One moment: marks on all time axes, boats on the track, numbers. `path` holds every row's motion.
// t, n, e, psi, u, v, r measured; model_* of the free predictions, NaN between them; X, Y missing [N].
const HULL = [[0.5, 0], [0.15, 0.22], [-0.5, 0.2], [-0.5, -0.2], [0.15, -0.22]];  // of a length of 1
const FRAME_MS = 66, DEG = 180 / Math.PI;

function row_at(time, t) {  // the last row at or before t
  let low = 0, high = time.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (time[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

function hull(d, prefix, k, length) {
  const n = d[prefix + "n"][k], e = d[prefix + "e"][k], psi = d[prefix + "psi"][k];
  if (!Number.isFinite(n + e + psi)) return null;
  const c = Math.cos(psi), s = Math.sin(psi);
  return {
    x: HULL.map(([a, b]) => e + length * (a * s + b * c)),
    y: HULL.map(([a, b]) => n + length * (a * c - b * s)),
  };
}

function numbers(d, prefix, k) {
  const [u, v, r] = ["u", "v", "r"].map(name => d[prefix + name][k]);
  if (!Number.isFinite(u + v + r)) return "–";
  const text = (x, digits) => x.toFixed(digits).replace("-", "−");
  return `u ${text(u, 2)} m/s, v ${text(v, 2)} m/s, r ${text(r * DEG, 1)} °/s`;
}

function show(t) {
  const d = path.data, quiet = {sync: false};
  if (!d.t || d.t.length === 0) return;
  const k = row_at(d.t, t), length = d.length[0];
  now.setv({data: {x: [t]}}, quiet);
  const drawn = [["", measured_colour], ["model_", model_colour]]
    .map(([prefix, colour]) => [hull(d, prefix, k, length), colour]).filter(([shape]) => shape);
  boats.setv({data: {
    xs: drawn.map(([shape]) => shape.x), ys: drawn.map(([shape]) => shape.y),
    colour: drawn.map(([, colour]) => colour),
  }}, quiet);
  const X = d.X[k], Y = d.Y[k], size = Math.hypot(X, Y), n = d.n[k], e = d.e[k];
  if (Number.isFinite(size + n + e) && size > d.noise[k]) {
    const c = Math.cos(d.psi[k]), s = Math.sin(d.psi[k]);
    const long = 2.5 * length * size / d.largest[0] / size;
    arrow.setv({data: {x0: [e], y0: [n], x1: [e + long * (X * s + Y * c)], y1: [n + long * (X * c - Y * s)]}}, quiet);
  } else {
    arrow.setv({data: {x0: [], y0: [], x1: [], y1: []}}, quiet);
  }
  readout.text = `<strong>${t.toFixed(1)} s</strong> &ensp; measured ${numbers(d, "", k)} &ensp; model ${numbers(d, "model_", k)}`;
}

if (what === "slide") {
  show(slider.value);
} else if (what === "tap") {
  slider.value = Math.min(Math.max(cb_obj.x, slider.start), slider.end);
} else if (what === "play") {
  clearInterval(window.shadowPlaying);
  play.label = play.active ? "Pause" : "Play";
  if (!play.active) {
    slider.value += 1e-6;  // the server hears of a change alone
  } else {
    if (slider.value >= slider.end - 0.1) slider.value = slider.start;
    let before = performance.now();
    window.shadowPlaying = setInterval(() => {
      const at = performance.now(), t = slider.value + (at - before) / 1000 * Number(speed.value);
      before = at;
      slider.setv({value: Math.min(t, slider.end)}, {sync: false});
      if (t >= slider.end) play.active = false;
    }, FRAME_MS);
  }
}
