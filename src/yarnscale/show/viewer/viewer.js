// Panes of a page that turn, stretch and play: tubes of yarns, cloth and bodies, drawn by three.js.
// A pane is an element with data-pane, the id of a script of JSON (show/pane.py); without WebGL its picture stays.
"use strict";
(() => {
const KINDS = { f4: Float32Array, i4: Int32Array, u1: Uint8Array };
const NUMBER = new Intl.NumberFormat("en", { maximumSignificantDigits: 4 });
const text = (value, least = 1e-9) => !Number.isFinite(value) ? "–" : Math.abs(value) < least ? "0"
  : (Math.abs(value) < 1e-4 ? value.toExponential(2) : NUMBER.format(value)).replaceAll("-", "−");
const linear = hex => new THREE.Color(hex).toArray();
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

async function unpacked(header) {
  const raw = atob(header.data), bytes = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
  header.data = "";
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer(), found = {};
  for (const [name, [kind, count, start]] of Object.entries(header.arrays)) found[name] = new KINDS[kind](buffer, start, count);
  return found;
}
// Whole numbers of 16 bits for every frame, stored as low bytes, then high bytes, of their differences from frame to frame.
function restored(planes, frames) {
  const count = planes.length / 2, each = count / frames, out = new Uint16Array(count);
  for (let k = 0; k < count; k++) out[k] = (planes[k] | planes[count + k] << 8) + (k < each ? 0 : out[k - each]);
  return out;
}
// --- what a pane shows: positions and values of a state ----------------------------------------------------------------

class Frames {
  constructor(header, arrays) {
    this.header = header;
    this.count = header.times.length;
    for (const part of ["cloth", "yarns", "bodies"]) if (arrays[part]) this[part] = restored(arrays[part], this.count);
    this.arrays = arrays;
    this.frame = this.count - 1;
  }
  points(part) {
    const all = this[part], each = all.length / this.count, start = this.frame * each, out = new Float32Array(each);
    const { low, step } = this.header.grid;
    for (let k = 0; k < each; k++) out[k] = low[k % 3] + step * all[start + k];
    return out;
  }
  values(part, field) {
    const all = this.arrays[field.array], each = all.length / this.count, out = new Float32Array(each);
    for (let k = 0; k < each; k++) out[k] = all[this.frame * each + k] / 255;
    return out;
  }
  numbers() { return []; }
}

// A periodic cell or a piece of sheet of one strain: fluctuations, energy and stress interpolated between states by radial
// functions |Δz| and a linear polynomial (detail.fluctuations.ScatteredFluctuations), placed on the midsurface (theory §2).
class Strained {
  constructor(header, arrays) {
    Object.assign(this, { header, arrays, strain: header.start.slice(), frame: 0, path: 0 });
    this.outputs = arrays.coefficients.length / (header.states + 1 + header.varying.length);
  }
  solve() {
    const { header: { states, varying, size }, arrays: { knots, coefficients }, outputs } = this;
    const place = varying.map(k => this.strain[k] / size[k]), found = new Float64Array(outputs);
    const add = (row, weight) => { for (let k = 0; k < outputs; k++) found[k] += weight * coefficients[row * outputs + k]; };
    this.nearest = Infinity;
    for (let j = 0; j < states; j++) {
      let square = 0;
      varying.forEach((_, k) => { square += (place[k] - knots[j * varying.length + k]) ** 2; });
      add(j, Math.sqrt(square));
      this.nearest = Math.min(this.nearest, Math.sqrt(square));
    }
    add(states, 1);
    place.forEach((value, k) => add(states + 1 + k, value));
    return found;
  }
  points() {
    const { reference, modes, vertex, tile } = this.arrays, found = this.solve(), { period, centre, floors } = this.header;
    const own = reference.length, moved = new Float64Array(own), place = midsurface(this.strain, centre);
    for (let mode = 0; 7 + mode < found.length; mode++)
      for (let k = 0; k < own; k++) moved[k] += found[7 + mode] * modes[mode * own + k];
    this.answer = Array.from(found.subarray(0, 7), (value, k) => floors[k] * Math.sinh(value));
    const out = new Float32Array(3 * vertex.length);
    for (let k = 0; k < vertex.length; k++) {
      const at = 3 * vertex[k];
      place(reference[at] + tile[2 * k] * period[0], reference[at + 1] + tile[2 * k + 1] * period[1], reference[at + 2],
        moved[at], moved[at + 1], moved[at + 2], out, 3 * k);
    }
    return out;
  }
  // Of the segment behind every point.
  lengths(points) {
    const { offsets } = this.arrays, found = new Float32Array(points.length / 3);
    for (let c = 0; c + 1 < offsets.length; c++) for (let k = offsets[c]; k < offsets[c + 1]; k++) {
      const i = 3 * Math.min(k, offsets[c + 1] - 2);
      found[k] = Math.hypot(points[i + 3] - points[i], points[i + 4] - points[i + 1], points[i + 5] - points[i + 2]);
    }
    return found;
  }
  // Stretch since the first state; colours reach as far as it does at the ends of the paths.
  values(part, field, points) {
    if (!this.rest) {
      const { strain, header: { start, paths } } = this;
      const ends = [start, ...paths.map(path => path.states.at(-1))].map(end => { this.strain = end; return this.lengths(this.points()); });
      this.rest = ends[0];
      field.high = ends.reduce((most, end) => end.reduce((high, length, k) => Math.max(high, Math.abs(length / this.rest[k] - 1)), most), 1e-3);
      field.low = -field.high;
      this.strain = strain;
      this.points();
    }
    return this.lengths(points).map((length, k) => 0.5 + 0.5 * (length / this.rest[k] - 1) / field.high);
  }
  numbers() {
    const names = this.header.answers.map(([name, unit, factor], k) => [name, `${text(factor * this.answer[k], 1e-5)} ${unit}`]);
    return [...names, ["distance from the nearest sample", `${text(100 * this.nearest, 0.01)} %`]];
  }
}
function midsurface([sx, sa, sy, p, q, r], [cx, cy]) {
  const a = 1 + sx, b = 1 + sy, e = a * a, f = sa * a * b, g = b * b, root = Math.sqrt(e * g - f * f);
  const trace = Math.sqrt(e + g + 2 * root), s00 = (e + root) / trace, s01 = f / trace, s11 = (g + root) / trace;
  // n,α = −II I⁻¹ a = −S I⁻¹ II by columns; ω_α = e3 × n,α.
  const det = root * root, i00 = g / det, i01 = -f / det, i11 = e / det;
  const m00 = i00 * p + i01 * q, m01 = i00 * q + i01 * r, m10 = i01 * p + i11 * q, m11 = i01 * q + i11 * r;
  const n00 = -(s00 * m00 + s01 * m10), n01 = -(s00 * m01 + s01 * m11), n10 = -(s01 * m00 + s11 * m10), n11 = -(s01 * m01 + s11 * m11);
  const ox = s00 * cx + s01 * cy, oy = s01 * cx + s11 * cy;
  return (x, y, h, ux, uy, uz, out, at) => {
    x -= cx; y -= cy;
    const wx = -(n10 * x + n11 * y), wy = n00 * x + n01 * y, square = wx * wx + wy * wy, angle = Math.sqrt(square);
    const sine = angle < 1e-4 ? 1 - square / 6 : Math.sin(angle) / angle, cosine = angle < 1e-4 ? 0.5 : (1 - Math.cos(angle)) / square;
    const third = angle < 1e-2 ? 1 / 6 - square / 120 : (angle - Math.sin(angle)) / (square * angle);
    // [w]× and its square, w in the plane.
    const dx = s00 * x + s01 * y, dy = s01 * x + s11 * y, up = wx * dy - wy * dx, turned = wx * ux + wy * uy;
    const vz = uz + h, along = wx * dx + wy * dy;
    const fx = dx + third * (wx * along - square * dx), fy = dy + third * (wy * along - square * dy);
    out[at] = ox + fx + ux + sine * wy * vz + cosine * (wx * turned - square * ux);
    out[at + 1] = oy + fy + uy - sine * wx * vz + cosine * (wy * turned - square * uy);
    out[at + 2] = cosine * up + vz + sine * (wx * uy - wy * ux) - cosine * square * vz;
  };
}

// --- meshes ------------------------------------------------------------------------------------------------------------

class Tubes {
  constructor(arrays, smooth, sides) {
    const { offsets, closed, radius } = arrays;
    const rings = [], starts = [0], faces = [];
    for (let c = 0; c < closed.length; c++) {
      const low = offsets[c], count = offsets[c + 1] - low, loop = closed[c];
      const at = k => low + (loop ? (k + 2 * count) % count : clamp(k, 0, count - 1)), segments = loop ? count : count - 1;
      for (let k = 0; k < segments; k++) for (let s = 0; s < smooth; s++) rings.push([at(k - 1), at(k), at(k + 1), at(k + 2), s / smooth, c]);
      rings.push([at(segments - 1), at(segments), at(segments), at(segments + 1), 0, c]);
      starts.push(rings.length);
    }
    const count = rings.length, caps = closed.length * 2;
    for (let c = 0; c < closed.length; c++) {
      for (let k = starts[c]; k + 1 < starts[c + 1]; k++) for (let s = 0; s < sides; s++) {
        const i = k * sides + s, j = k * sides + (s + 1) % sides;
        faces.push(i, j, j + sides, i, j + sides, i + sides);
      }
      for (let end = 0; end < 2; end++) for (let s = 1; s + 1 < sides; s++) {
        const i = (count + 2 * c + end) * sides;
        faces.push(i, i + (end ? s : s + 1), i + (end ? s + 1 : s));
      }
    }
    Object.assign(this, { sides, starts, count, radius, curves: closed.length });
    this.at = new Int32Array(4 * count);
    this.weights = new Float32Array(4 * count);
    this.curve = new Int32Array(count);
    rings.forEach(([a, b, c, d, t, curve], k) => {
      this.at.set([a, b, c, d], 4 * k);
      // Catmull–Rom.
      this.weights.set([-0.5 * t + t * t - 0.5 * t ** 3, 1 - 2.5 * t * t + 1.5 * t ** 3, 0.5 * t + 2 * t * t - 1.5 * t ** 3, 0.5 * (t ** 3 - t * t)], 4 * k);
      this.curve[k] = curve;
    });
    const corners = (count + caps) * sides, geometry = new THREE.BufferGeometry();
    for (const name of ["position", "normal", "color"]) geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * corners), 3));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(faces), 1));
    this.geometry = geometry;
    this.material = new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.72 });
    this.mesh = new THREE.Mesh(geometry, this.material);
    this.mesh.castShadow = this.mesh.receiveShadow = true;
    this.mesh.frustumCulled = false;
    this.angles = Array.from({ length: sides }, (_, s) => [Math.cos(2 * Math.PI * s / sides), Math.sin(2 * Math.PI * s / sides)]);
  }
  update(points, scale, origin) {
    const { sides, starts, count, at, weights, angles } = this, line = new Float32Array(3 * count);
    for (let k = 0; k < count; k++) for (let axis = 0; axis < 3; axis++) {
      let sum = 0;
      for (let j = 0; j < 4; j++) sum += weights[4 * k + j] * points[3 * at[4 * k + j] + axis];
      line[3 * k + axis] = scale * (sum - origin[axis]);
    }
    const place = this.geometry.attributes.position.array, normal = this.geometry.attributes.normal.array;
    for (let c = 0; c < this.curves; c++) {
      let nx = 0, ny = 0, nz = 0;
      const first = starts[c], last = starts[c + 1] - 1, radius = scale * this.radius[c];
      for (let k = first; k <= last; k++) {
        const i = 3 * Math.max(k - 1, first), j = 3 * Math.min(k + 1, last);
        let tx = line[j] - line[i], ty = line[j + 1] - line[i + 1], tz = line[j + 2] - line[i + 2];
        const length = Math.hypot(tx, ty, tz) || 1;
        tx /= length; ty /= length; tz /= length;
        if (k === first) [nx, ny, nz] = Math.abs(tz) < 0.9 ? [0, 0, 1] : [1, 0, 0];
        // The part of the last normal across the tangent.
        const along = nx * tx + ny * ty + nz * tz;
        nx -= along * tx; ny -= along * ty; nz -= along * tz;
        const size = Math.hypot(nx, ny, nz) || 1;
        nx /= size; ny /= size; nz /= size;
        const bx = ty * nz - tz * ny, by = tz * nx - tx * nz, bz = tx * ny - ty * nx;
        const cap = k === first ? 0 : k === last ? 1 : -1;
        for (let s = 0; s < sides; s++) {
          const [cos, sin] = angles[s], ux = cos * nx + sin * bx, uy = cos * ny + sin * by, uz = cos * nz + sin * bz, o = 3 * (k * sides + s);
          place[o] = line[3 * k] + radius * ux; place[o + 1] = line[3 * k + 1] + radius * uy; place[o + 2] = line[3 * k + 2] + radius * uz;
          normal[o] = ux; normal[o + 1] = uy; normal[o + 2] = uz;
          if (cap < 0) continue;
          const e = 3 * ((count + 2 * c + cap) * sides + s), sign = cap ? 1 : -1;
          place[e] = place[o]; place[e + 1] = place[o + 1]; place[e + 2] = place[o + 2];
          normal[e] = sign * tx; normal[e + 1] = sign * ty; normal[e + 2] = sign * tz;
        }
      }
    }
    this.geometry.attributes.position.needsUpdate = this.geometry.attributes.normal.needsUpdate = true;
  }
  // colour: of a point of a curve, as three linear numbers.
  paint(colour) {
    const { sides, starts, count, at } = this, paints = this.geometry.attributes.color, array = paints.array;
    for (let k = 0; k < count; k++) {
      const [r, g, b] = colour(at[4 * k + 1], this.curve[k]), c = this.curve[k];
      const fill = ring => { for (let s = 0; s < sides; s++) { const o = 3 * (ring * sides + s); array[o] = r; array[o + 1] = g; array[o + 2] = b; } };
      fill(k);
      if (k === starts[c]) fill(count + 2 * c);
      if (k === starts[c + 1] - 1) fill(count + 2 * c + 1);
    }
    paints.needsUpdate = true;
  }
}

class Surface {
  constructor(triangles, colours, count) {
    this.geometry = new THREE.BufferGeometry();
    this.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(count), 3));
    this.geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(count).fill(1), 3));
    this.geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(triangles), 1));
    this.colours = colours;
    this.mesh = new THREE.Group();
    const sides = colours.length === 1 ? [THREE.DoubleSide] : [THREE.FrontSide, THREE.BackSide];
    this.materials = sides.map((side, k) => new THREE.MeshStandardMaterial({ side, shadowSide: side, vertexColors: true, color: colours[k], roughness: 0.85 }));
    for (const material of this.materials) {
      const mesh = new THREE.Mesh(this.geometry, material);
      mesh.castShadow = mesh.receiveShadow = true;
      mesh.frustumCulled = false;
      this.mesh.add(mesh);
    }
  }
  update(points, scale, origin) {
    const place = this.geometry.attributes.position;
    for (let k = 0; k < points.length; k++) place.array[k] = scale * (points[k] - origin[k % 3]);
    place.needsUpdate = true;
    this.geometry.computeVertexNormals();
  }
  paint(colour) {
    const paints = this.geometry.attributes.color;
    for (let k = 0; k < paints.count; k++) paints.array.set(colour ? colour(k) : [1, 1, 1], 3 * k);
    paints.needsUpdate = true;
    this.materials.forEach((material, k) => material.color.set(colour ? "#ffffff" : this.colours[k]));
  }
}

// --- panes -------------------------------------------------------------------------------------------------------------

let renderer = null;
function sharedRenderer() {
  if (renderer) return renderer;
  const probe = document.createElement("canvas");
  renderer = new THREE.WebGLRenderer({ canvas: probe, antialias: true, alpha: true });
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFShadowMap;
  return renderer;
}
function make(name, parent, settings = {}) {
  const node = document.createElement(name);
  Object.assign(node, settings);
  parent.append(node);
  return node;
}

class Pane {
  constructor(element, header, arrays) {
    this.element = element;
    this.header = header;
    this.model = header.times ? new Frames(header, arrays) : new Strained(header, arrays);
    this.scale = 1 / header.radius;
    this.box = new THREE.Box3();
    this.scene = new THREE.Scene();
    this.camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.01, 40);
    this.camera.up.set(...header.up);
    this.scene.add(this.camera, new THREE.HemisphereLight("#ffffff", "#8c96a0", 1.5));
    const lamp = new THREE.DirectionalLight("#ffffff", 2.1), side = new THREE.DirectionalLight("#ffffff", 0.5);
    lamp.position.set(-2.4, 3.2, 1.5);
    lamp.castShadow = true;
    lamp.shadow.mapSize.set(2048, 2048);
    Object.assign(lamp.shadow.camera, { left: -1.5, right: 1.5, top: 1.5, bottom: -1.5, near: 0.1, far: 20 });
    lamp.shadow.normalBias = 0.004;
    lamp.shadow.bias = -0.0004;
    lamp.shadow.radius = 3;
    side.position.set(3, 0.5, 2);
    lamp.target.position.set(0, 0, -8);
    side.target.position.set(0, 0, -8);
    this.camera.add(lamp, lamp.target, side, side.target);
    this.parts = [];
    const points = arrays.offsets ? arrays.offsets[arrays.offsets.length - 1] : 0;
    if (points) {
      const smooth = points < 4000 ? 5 : points < 20000 ? 3 : points < 60000 ? 2 : 1, sides = points < 20000 ? 14 : points < 60000 ? 8 : 5;
      this.parts.push(["yarns", new Tubes(arrays, smooth, sides)]);
    }
    if (arrays.triangles) this.parts.push(["cloth", new Surface(arrays.triangles, header.cloth_colours, this.model.points("cloth").length)]);
    if (arrays.body_triangles) this.parts.push(["bodies", new Surface(arrays.body_triangles, [header.body_colour], this.model.points("bodies").length)]);
    for (const [, part] of this.parts) this.scene.add(part.mesh);
    this.arrays = arrays;
    this.colour = header.colours[0];
    this.build();
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.enableZoom = false;
    this.canvas.style.touchAction = "pan-y";
    this.controls.addEventListener("change", () => this.draw());
    this.resize();
    this.show();
    this.aim();
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }
  // The camera in its first direction, as near as the box of what is shown allows.
  aim() {
    const { camera, controls: { target } } = this;
    this.box.getCenter(target);
    camera.position.set(...this.header.eye).normalize().multiplyScalar(8).add(target);
    camera.lookAt(target);
    camera.updateMatrixWorld();
    const { min, max } = this.box.clone().applyMatrix4(camera.matrixWorldInverse);
    camera.zoom = 0.94 / Math.max(-min.x / camera.right, max.x / camera.right, -min.y / camera.top, max.y / camera.top);
    camera.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }
  build() {
    const stage = this.element.querySelector(".stage"), panel = make("div", this.element, { className: "panel" });
    this.canvas = make("canvas", stage, { tabIndex: 0 });
    this.canvas.setAttribute("aria-label", `${this.header.title}: drag or use the arrow keys to turn`);
    this.canvas.addEventListener("keydown", event => this.key(event));
    this.canvas.addEventListener("focus", () => { this.controls.enableZoom = true; });
    this.canvas.addEventListener("blur", () => { this.controls.enableZoom = false; });
    this.canvas.addEventListener("pointerdown", () => this.canvas.focus({ preventScroll: true }));
    const tools = make("div", panel, { className: "tools" });
    if (this.header.colours.length > 1) {
      const label = make("label", tools, { textContent: "colour " }), choice = make("select", label);
      this.header.colours.forEach((colour, k) => make("option", choice, { value: k, textContent: colour.name }));
      choice.addEventListener("change", () => { this.colour = this.header.colours[choice.value]; this.show(); });
    }
    const wires = make("label", tools), box = make("input", wires, { type: "checkbox" });
    wires.append(" wireframe");
    box.addEventListener("change", () => {
      for (const [, part] of this.parts) for (const material of part.materials || [part.material]) material.wireframe = box.checked;
      this.draw();
    });
    make("button", tools, { textContent: "fit view" }).addEventListener("click", () => this.aim());
    make("button", tools, { textContent: "save picture" }).addEventListener("click", () => this.save());
    const paths = this.header.paths;
    if (paths && paths.length) {
      const choice = make("select", make("label", tools, { textContent: "along " }));
      paths.forEach((path, k) => make("option", choice, { value: k, textContent: path.name }));
      choice.addEventListener("change", () => { this.model.path = +choice.value; this.steps(); this.go(0); });
    }
    if (paths ? paths.length : this.header.times.length > 1) {
      const bar = make("div", panel, { className: "bar" });
      this.button = make("button", bar, { textContent: "▶", ariaLabel: "play" });
      this.bar = make("input", bar, { type: "range", min: 0, value: 0, ariaLabel: "moment" });
      this.moment = make("output", bar);
      this.button.addEventListener("click", () => this.play(!this.playing));
      this.bar.addEventListener("input", () => { this.play(false); this.go(+this.bar.value); });
      this.steps();
      this.bar.value = this.model.frame;
    }
    this.sliders = [];
    const wide = this.element.classList.contains("wide"), more = !paths || wide ? panel : make("details", panel);
    if (more !== panel) make("summary", more, { textContent: "strains and stresses" });
    if (paths) {
      const rows = make("div", more, { className: "sliders" });
      this.header.varying.forEach(k => {
        const [name, unit, factor] = this.header.components[k], [low, high] = this.header.range[k];
        const row = make("label", rows, { textContent: name }), slider = make("input", row, { type: "range", min: low, max: high, step: (high - low) / 400, value: this.model.strain[k] });
        const shown = make("output", row);
        slider.addEventListener("input", () => { this.play(false); this.model.strain[k] = +slider.value; this.show(); });
        this.sliders.push(() => { slider.value = this.model.strain[k]; shown.textContent = `${text(factor * this.model.strain[k], 0.01)} ${unit}`; });
      });
    }
    this.table = make("dl", more, { className: "numbers" });
  }
  // A step of the bar is a frame, or a twentieth of the path from one equilibrium to the next.
  steps() { this.bar.max = this.header.times ? this.header.times.length - 1 : 20 * (this.header.paths[this.model.path].states.length - 1); }
  go(step) {
    this.bar.value = step;
    if (this.header.times) this.model.frame = step;
    else {
      const { states } = this.header.paths[this.model.path], k = Math.min(Math.floor(step / 20), states.length - 2), t = step / 20 - k;
      this.model.strain = states[k].map((value, i) => (1 - t) * value + t * states[k + 1][i]);
    }
    this.show();
  }
  play(on) {
    if (on === !!this.playing || !this.bar) return;
    this.playing = on ? performance.now() : 0;
    this.button.textContent = on ? "❚❚" : "▶";
    if (!on) return;
    const last = +this.bar.max, times = this.header.times;
    // In real time, or in four seconds where that would be over at once or last long.
    const whole = times ? times[times.length - 1] - times[0] : 0, seconds = whole > 2 && whole < 15 ? whole : 4;
    let began = null;
    const from = +this.bar.value >= last ? 0 : +this.bar.value;
    const tick = now => {
      if (!this.playing) return;
      began = began === null ? now : began;
      const step = Math.min(last, from + Math.round((now - began) / 1000 / seconds * last));
      if (step !== +this.bar.value) this.go(step);
      if (step >= last) this.play(false);
      else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }
  key(event) {
    const step = Math.PI / 24, moves = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (event.key in moves) { this.controls.rotateLeft(moves[event.key][0]); this.controls.rotateUp(moves[event.key][1]); }
    else if (event.key === "+" || event.key === "-") {
      this.camera.zoom = clamp(this.camera.zoom * (event.key === "+" ? 1.15 : 1 / 1.15), 0.1, 100);
      this.camera.updateProjectionMatrix();
      this.draw();
    } else if (event.key === " ") this.play(!this.playing);
    else if (event.key === "Home") this.aim();
    else return;
    event.preventDefault();
  }
  resize() {
    const ratio = Math.min(devicePixelRatio || 1, 2), width = Math.round(this.canvas.clientWidth * ratio), height = Math.round(this.canvas.clientHeight * ratio);
    if (!width || !height) return;
    this.canvas.width = width;
    this.canvas.height = height;
    const half = Math.max(1, width / height);
    Object.assign(this.camera, { left: -half, right: half, top: half * height / width, bottom: -half * height / width });
    this.camera.updateProjectionMatrix();
    this.draw();
  }
  // Positions and colours of the state, then a picture.
  show() {
    const { model, header, arrays, colour } = this, palette = header.palette.map(linear), grey = linear(header.faint), map = header.map.map(linear);
    const mapped = share => {
      const place = clamp(share, 0, 1) * (map.length - 1), k = Math.min(Math.floor(place), map.length - 2), t = place - k;
      return map[k].map((value, i) => (1 - t) * value + t * map[k + 1][i]);
    };
    for (const [name, part] of this.parts) {
      const points = model.points(name);
      part.update(points, this.scale, header.centre3);
      if (name === "bodies") continue;
      this.box.setFromArray(header.box || points).translate(new THREE.Vector3(...header.centre3).negate());
      for (const end of [this.box.min, this.box.max]) end.multiplyScalar(this.scale);
      const field = (colour.fields || {})[name], values = field && model.values(name, field, points);
      if (name === "yarns") {
        const plain = arrays.yarn, faded = palette.map(own => own.map((value, i) => 0.25 * value + 0.75 * grey[i]));
        part.paint(values ? point => mapped(values[point])
          : (point, curve) => (colour.fade && !arrays.solid[point] ? faded : palette)[plain[curve] % palette.length]);
      } else if (name === "cloth") part.paint(values ? k => mapped(values[k]) : arrays.tint ? k => arrays.tint[k] ? grey : palette[0] : null);
    }
    for (const slider of this.sliders) slider();
    const rows = model.numbers();
    if (this.moment) {
      const labels = header.times ? `t = ${text(header.times[model.frame])} s` : `${Math.round(100 * this.bar.value / this.bar.max)} %`;
      this.moment.textContent = labels;
    }
    if (this.table.childElementCount !== rows.length) {
      this.table.textContent = "";
      for (const [name] of rows) { const row = make("div", this.table); make("dt", row, { textContent: name }); make("dd", row); }
    }
    rows.forEach(([, value], k) => { this.table.children[k].lastChild.textContent = value; });
    this.draw();
  }
  draw() {
    if (this.waiting || !this.controls) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.render(); });
  }
  render() {
    const { width, height } = this.canvas, gl = sharedRenderer(), pen = this.canvas.getContext("2d");
    if (!width || !height) return;
    gl.setSize(width, height, false);
    gl.setClearColor("#ffffff", 1);
    gl.render(this.scene, this.camera);
    pen.drawImage(gl.domElement, 0, 0);
    this.label(pen, width, height);
    this.drawn = (this.drawn || 0) + 1;
  }
  // A scale bar, and the colours with their values.
  label(pen, width, height) {
    const ratio = width / this.canvas.clientWidth, metre = width / (this.camera.right - this.camera.left) * this.camera.zoom * this.scale;
    const room = 0.22 * width / metre, power = 10 ** Math.floor(Math.log10(room)), length = [5, 2, 1].find(k => k * power <= room) * power;
    const size = 12 * ratio, left = 14 * ratio, low = height - 14 * ratio;
    const field = Object.values(this.colour.fields || {})[0], wide = 150 * ratio, right = width - 14 * ratio - wide;
    pen.font = `${size}px system-ui, sans-serif`;
    pen.fillStyle = "#ffffffc0";
    pen.fillRect(left - 8 * ratio, low - 24 * ratio, length * metre + 16 * ratio, 32 * ratio);
    if (field) pen.fillRect(right - 24 * ratio, low - 50 * ratio, wide + 32 * ratio, 58 * ratio);
    pen.fillStyle = pen.strokeStyle = "#22303c";
    pen.lineWidth = 2 * ratio;
    pen.beginPath();
    pen.moveTo(left, low - 5 * ratio); pen.lineTo(left, low); pen.lineTo(left + length * metre, low); pen.lineTo(left + length * metre, low - 5 * ratio);
    pen.stroke();
    pen.textAlign = "left";
    pen.fillText(length < 0.01 ? `${text(1e3 * length)} mm` : length < 1 ? `${text(1e2 * length)} cm` : `${text(length)} m`, left, low - 9 * ratio);
    if (!field) return;
    const fill = pen.createLinearGradient(right, 0, right + wide, 0);
    this.header.map.forEach((hex, k) => fill.addColorStop(k / (this.header.map.length - 1), hex));
    pen.fillText(text(field.factor * field.low), right, low);
    pen.textAlign = "right";
    pen.fillText(field.label, right + wide, low - 34 * ratio);
    pen.fillText(`${text(field.factor * field.high)} ${field.unit}`, right + wide, low);
    pen.fillStyle = fill;
    pen.fillRect(right, low - 28 * ratio, wide, 12 * ratio);
  }
  save() {
    this.render();
    this.canvas.toBlob(picture => {
      const link = make("a", document.body, { href: URL.createObjectURL(picture), download: `${this.header.title.replace(/[^\w-]+/g, "-")}.png` });
      link.click();
      link.remove();
    });
  }
}

window.panes = [];
async function start(element) {
  const header = JSON.parse(document.getElementById(element.dataset.pane).textContent);
  const pane = new Pane(element, header, await unpacked(header));
  element.classList.add("alive");
  pane.number = +element.dataset.pane.replace("pane-", "");
  window.panes.push(pane);
  window.panes.sort((a, b) => a.number - b.number);
}
document.addEventListener("DOMContentLoaded", () => {
  try { sharedRenderer(); } catch { document.body.classList.add("still"); return; }
  // Panes come to life when they come into view.
  const watch = new IntersectionObserver(entries => entries.filter(entry => entry.isIntersecting).forEach(entry => {
    watch.unobserve(entry.target);
    start(entry.target);
  }), { rootMargin: "200px" });
  document.querySelectorAll("[data-pane]").forEach(element => watch.observe(element));
});
})();
