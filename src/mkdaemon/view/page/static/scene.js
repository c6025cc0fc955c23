// The aircraft over its target in three dimensions, drawn with WebGL and nothing else. x right, y to the top of the
// print, z up [m].

const LINE_SHADER = `
attribute vec3 from; attribute vec3 to; attribute vec2 corner; attribute vec4 colour; attribute float wide;
uniform mat4 view; uniform vec2 screen; varying vec4 shade;
void main() {
  vec4 a = view * vec4(from, 1.0), b = view * vec4(to, 1.0);
  float near = 0.01;
  if (a.w < near && b.w >= near) a = mix(a, b, (near - a.w) / (b.w - a.w));
  if (b.w < near && a.w >= near) b = mix(b, a, (near - b.w) / (a.w - b.w));
  vec2 along = normalize((b.xy / b.w - a.xy / a.w) * screen + vec2(1e-6, 0.0));
  vec4 here = corner.x < 0.5 ? a : b;
  here.xy += vec2(-along.y, along.x) * corner.y * wide / screen * here.w;
  gl_Position = here; shade = colour;
}`;
const FACE_SHADER = `
attribute vec3 place; attribute vec4 colour; uniform mat4 view; varying vec4 shade;
void main() { gl_Position = view * vec4(place, 1.0); shade = colour; }`;
const SHADE = `precision mediump float; varying vec4 shade; void main() { gl_FragColor = shade; }`;
const IMAGE_SHADER = `
attribute vec3 place; attribute vec2 spot; uniform mat4 view; varying vec2 at;
void main() { gl_Position = view * vec4(place, 1.0); at = spot; }`;
const IMAGE_SHADE = `precision mediump float; varying vec2 at; uniform sampler2D image;
void main() { gl_FragColor = vec4(texture2D(image, at).rgb, 0.92); }`;
const REST = {turn: -0.9, tilt: 0.42, zoom: 1};
const PIXELS = 2; // at most, for each of the screen's

/** Draws what `page.js` keeps. */
export class Scene {
  constructor(world, labels) {
    this.world = world;
    this.pen = labels.getContext("2d");
    this.labels = labels;
    this.eye = {...REST};
    this.middle = [0, 0, 0.8];
    this.reach = 5;
    this.textures = new Map();
    const gl = this.gl = world.getContext("webgl", {alpha: false, antialias: true});
    if (!gl) return;
    this.lines = program(gl, LINE_SHADER, SHADE);
    this.faces = program(gl, FACE_SHADER, SHADE);
    this.images = program(gl, IMAGE_SHADER, IMAGE_SHADE);
    this.buffer = gl.createBuffer();
  }

  /** Whether this browser can draw it. */
  get works() { return Boolean(this.gl); }

  /** Let the mouse turn and zoom; `redraw` is called after every change. */
  listen(redraw) {
    this.world.addEventListener("pointerdown", (event) => this.world.setPointerCapture(event.pointerId));
    this.world.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      this.eye.turn -= event.movementX * 0.006;
      this.eye.tilt = Math.min(1.55, Math.max(-0.1, this.eye.tilt + event.movementY * 0.006));
      redraw();
    });
    this.world.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.eye.zoom = Math.min(8, Math.max(0.15, this.eye.zoom * Math.exp(event.deltaY * 0.001)));
      redraw();
    }, {passive: false});
    this.world.addEventListener("dblclick", () => { this.eye = {...REST}; redraw(); });
  }

  /**
   * Draw everything.
   * @param {object} scene aircraft, goal, path, fence, as the server says
   * @param {object[]} tags of the target
   * @param {number[][]} trail points: time, x, y, z
   * @param {object[]} cameras with frustum, and `canvas` where an image came
   */
  draw(scene, tags, trail, cameras) {
    const gl = this.gl;
    if (!gl) return;
    const scale = Math.min(window.devicePixelRatio || 1, PIXELS);
    for (const canvas of [this.world, this.labels]) {
      const wide = Math.round(canvas.clientWidth * scale), tall = Math.round(canvas.clientHeight * scale);
      if (canvas.width !== wide || canvas.height !== tall) { canvas.width = wide; canvas.height = tall; }
    }
    const paint = palette();
    this.aim(scene);
    this.view = this.project();
    gl.viewport(0, 0, this.world.width, this.world.height);
    gl.clearColor(...paint("--ground"));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    const solid = [], thin = [], glass = [];
    ground(thin, scene, paint);
    for (const [k, tag] of tags.entries()) print(solid, tag, 0.002 * (k + 1), paint);
    const aircraft = scene.aircraft;
    if (aircraft) {
      const fade = aircraft.is_stale ? 0.35 : 1;
      craft(solid, glass, aircraft, fade, paint);
      const [x, y, z] = aircraft.position;
      segment(thin, [x, y, z], [x, y, 0], paint("--soft", 0.7 * fade), 1);
      if (aircraft.spread) ball(glass, aircraft.position, aircraft.spread, paint("--spread", 0.35 * fade));
    }
    const way = scene.path || [];
    for (let k = 1; k < way.length; k++) segment(thin, way[k - 1], way[k], paint("--goal", 0.45), 1.5);
    path(thin, trail, paint("--trail"));
    if (scene.goal) {
      diamond(solid, scene.goal, 0.07, paint("--goal"));
      if (aircraft && !aircraft.is_stale) segment(thin, aircraft.position, scene.goal, paint("--goal", 0.9), 1.5);
    }
    if (scene.fence) barrier(thin, scene.fence, paint);
    for (const camera of cameras) if (camera.frustum) beam(thin, camera.frustum, paint("--beam", 0.85));
    this.drawFaces(solid);
    this.drawLines(thin, scale);
    for (const camera of cameras) if (camera.frustum && camera.canvas) this.drawImage(camera);
    gl.depthMask(false);
    this.drawFaces(glass);
    gl.depthMask(true);
    this.write(scene, scale, paint);
  }

  /** Keep the target and the aircraft in sight, without a jump. */
  aim(scene) {
    const place = scene.aircraft ? scene.aircraft.position : [0, 0, 1.5];
    const wanted = [place[0] / 2, place[1] / 2, Math.max(0, place[2]) / 2];
    const reach = Math.max(2.2, Math.hypot(...place) * 1.75);
    const step = this.aimed ? 0.08 : 1;
    this.aimed = this.aimed || Boolean(scene.aircraft);
    this.middle = this.middle.map((part, k) => part + (wanted[k] - part) * step);
    this.reach += (reach - this.reach) * step;
  }

  /** The matrix from the world to the screen. */
  project() {
    const {turn, tilt, zoom} = this.eye, far = this.reach * zoom;
    const back = [Math.cos(tilt) * Math.cos(turn), Math.cos(tilt) * Math.sin(turn), Math.sin(tilt)];
    const right = [-Math.sin(turn), Math.cos(turn), 0];
    const up = cross(back, right);
    const eye = this.middle.map((part, k) => part + back[k] * far);
    const dot = (axis) => -(axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2]);
    const look = [
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, dot(right), dot(up), dot(back), 1,
    ];
    const near = 0.05, end = 200, lens = 1 / Math.tan(0.42);
    const ratio = this.world.width / Math.max(1, this.world.height);
    const squeeze = [
      lens / ratio, 0, 0, 0, 0, lens, 0, 0, 0, 0, (end + near) / (near - end), -1, 0, 0, 2 * end * near / (near - end), 0,
    ];
    return multiply(squeeze, look);
  }

  /** Where a point is on the screen [px]; null behind the eye. */
  spot(point) {
    const m = this.view, [x, y, z] = point;
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (w < 0.05) return null;
    const across = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w, high = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
    return [(across + 1) / 2 * this.labels.width, (1 - high) / 2 * this.labels.height];
  }

  /** Words in the scene. */
  write(scene, scale, paint) {
    const pen = this.pen;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.labels.width, this.labels.height);
    pen.font = `${12 * scale}px system-ui, 'DejaVu Sans', sans-serif`;
    const put = (text, point, name, shift = [6, -6]) => {
      const at = this.spot(point);
      if (!at) return;
      pen.fillStyle = css(paint(name));
      pen.fillText(text, at[0] + shift[0] * scale, at[1] + shift[1] * scale);
    };
    put("x", [1, 0, 0], "--front");
    put("y", [0, 1, 0], "--goal");
    put("1 m", [1, 0, 0], "--soft", [14, 6]);
    if (scene.aircraft) {
      const [x, y, z] = scene.aircraft.position;
      put(`${z.toFixed(2)} m`, [x, y, z / 2], "--ink");
      if (scene.aircraft.is_stale) put(`last seen ${scene.aircraft.age.toFixed(0)} s ago`, [x, y, z], "--bad", [14, -14]);
    }
    if (scene.goal) put("goal", scene.goal, "--goal", [10, 4]);
  }

  drawFaces(points) {
    if (!points.length) return;
    const gl = this.gl;
    gl.useProgram(this.faces);
    this.load(this.faces, points, [["place", 3], ["colour", 4]]);
    gl.drawArrays(gl.TRIANGLES, 0, points.length / 7);
  }

  drawLines(segments, scale) {
    const gl = this.gl, points = [];
    for (const [from, to, colour, wide] of segments) {
      for (const corner of [[0, -1], [0, 1], [1, -1], [1, -1], [0, 1], [1, 1]]) {
        points.push(...from, ...to, ...corner, ...colour, wide * scale);
      }
    }
    gl.useProgram(this.lines);
    gl.uniform2f(gl.getUniformLocation(this.lines, "screen"), this.world.width, this.world.height);
    this.load(this.lines, points, [["from", 3], ["to", 3], ["corner", 2], ["colour", 4], ["wide", 1]]);
    gl.drawArrays(gl.TRIANGLES, 0, points.length / 13);
  }

  drawImage(camera) {
    const gl = this.gl;
    let texture = this.textures.get(camera.name);
    if (!texture) this.textures.set(camera.name, texture = gl.createTexture());
    gl.useProgram(this.images);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    if (texture.drawn !== camera.drawn) {
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, camera.canvas);
      for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE],
        [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(gl.TEXTURE_2D, name, value);
      texture.drawn = camera.drawn;
    }
    const [a, b, c, d] = camera.frustum.image;
    const points = [a, 0, 0, b, 1, 0, c, 1, 1, a, 0, 0, c, 1, 1, d, 0, 1].flat();
    this.load(this.images, points, [["place", 3], ["spot", 2]]);
    gl.drawArrays(gl.TRIANGLES, 0, 6);
  }

  load(used, points, parts) {
    const gl = this.gl, size = parts.reduce((sum, [, count]) => sum + count, 0) * 4;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points), gl.STREAM_DRAW);
    gl.uniformMatrix4fv(gl.getUniformLocation(used, "view"), false, new Float32Array(this.view));
    let offset = 0;
    for (let k = 0; k < 8; k++) gl.disableVertexAttribArray(k);
    for (const [name, count] of parts) {
      const place = gl.getAttribLocation(used, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, count, gl.FLOAT, false, size, offset);
      offset += count * 4;
    }
  }
}

// -- what there is in the scene ---------------------------------------------------------------------------------------

function ground(thin, scene, paint) {
  const far = Math.ceil(Math.min(20, scene.fence ? scene.fence.radius : 5));
  for (let k = -far; k <= far; k++) {
    const colour = paint("--grid", k ? 0.6 : 1);
    segment(thin, [k, -far, 0], [k, far, 0], colour, 1);
    segment(thin, [-far, k, 0], [far, k, 0], colour, 1);
  }
  segment(thin, [0, 0, 0.001], [1, 0, 0.001], paint("--front"), 2);
  segment(thin, [0, 0, 0.001], [0, 1, 0.001], paint("--goal"), 2);
}

function print(solid, tag, lift, paint) {
  const rows = tag.cells.length, [tl, tr, br, bl] = tag.corners.map(([x, y, z]) => [x, y, z + lift]);
  const at = (u, v) => tl.map((part, k) => part * (1 - u) * (1 - v) + tr[k] * u * (1 - v) + br[k] * u * v + bl[k] * (1 - u) * v);
  const cell = (u, v, s, colour) => quad(solid, at(u, v), at(u + s, v), at(u + s, v + s), at(u, v + s), colour);
  const rim = 1 / rows;
  const paper = [at(-rim, -rim), at(1 + rim, -rim), at(1 + rim, 1 + rim), at(-rim, 1 + rim)].map(([x, y, z]) => [x, y, z - 0.001]);
  quad(solid, ...paper, paint("--paper"));
  tag.cells.forEach((row, k) => {
    for (let j = 0; j < row.length; j++) if (row[j] === "#") cell(j / rows, k / rows, 1 / rows, paint("--print"));
  });
}

function craft(solid, glass, aircraft, fade, paint) {
  const turn = aircraft.rotation, place = aircraft.position, arm = 0.24;
  const out = ([x, y, z]) => turn.map((row, k) => place[k] + row[0] * x + row[1] * y + row[2] * z);
  const block = (low, high, colour) => {
    const corner = (k) => out([k & 1 ? high[0] : low[0], k & 2 ? high[1] : low[1], k & 4 ? high[2] : low[2]]);
    for (const [a, b, c, d, light] of [[4, 5, 7, 6, 1], [0, 2, 3, 1, 0.55], [0, 1, 5, 4, 0.8], [2, 6, 7, 3, 0.8],
      [0, 4, 6, 2, 0.7], [1, 3, 7, 5, 0.9]]) {
      const shade = [colour[0] * light, colour[1] * light, colour[2] * light, colour[3]];
      quad(solid, corner(a), corner(b), corner(c), corner(d), shade);
    }
  };
  const body = paint("--body", fade), front = paint("--front", fade);
  block([-0.06, -0.06, -0.03], [0.06, 0.06, 0.04], body);
  block([0.05, -0.012, -0.008], [arm, 0.012, 0.012], front);
  block([-arm, -0.012, -0.008], [-0.05, 0.012, 0.012], body);
  block([-0.012, 0.05, -0.008], [0.012, arm, 0.012], body);
  block([-0.012, -arm, -0.008], [0.012, -0.05, 0.012], body);
  for (const [x, y, name] of [[arm, 0, "--front"], [-arm, 0, "--rotor"], [0, arm, "--rotor"], [0, -arm, "--rotor"]]) {
    const colour = paint(name, 0.4 * fade);
    for (let k = 0; k < 20; k++) {
      const rim = (j) => out([x + 0.125 * Math.cos(j * Math.PI / 10), y + 0.125 * Math.sin(j * Math.PI / 10), 0.025]);
      glass.push(...out([x, y, 0.025]), ...colour, ...rim(k), ...colour, ...rim(k + 1), ...colour);
    }
  }
  const shadow = [0, 0, 0, 0.16 * fade];
  for (let k = 0; k < 20; k++) {
    const rim = (j) => [place[0] + 0.2 * Math.cos(j * Math.PI / 10), place[1] + 0.2 * Math.sin(j * Math.PI / 10), 0.008];
    glass.push(place[0], place[1], 0.008, ...shadow, ...rim(k), ...shadow, ...rim(k + 1), ...shadow);
  }
}

function ball(glass, middle, shape, colour) {
  const at = (u, v) => {
    const unit = [Math.cos(u) * Math.cos(v), Math.sin(u) * Math.cos(v), Math.sin(v)];
    return shape.map((row, k) => middle[k] + row[0] * unit[0] + row[1] * unit[1] + row[2] * unit[2]);
  };
  for (let j = -4; j < 4; j++) {
    for (let k = 0; k < 16; k++) {
      const u = k * Math.PI / 8, v = j * Math.PI / 8, s = Math.PI / 8;
      quad(glass, at(u, v), at(u + s, v), at(u + s, v + s), at(u, v + s), colour);
    }
  }
}

function diamond(solid, middle, size, colour) {
  const tip = (k, way) => middle.map((part, j) => part + (j === k ? way * size : 0));
  for (const up of [-1, 1]) {
    for (const [a, b] of [[tip(0, 1), tip(1, 1)], [tip(1, 1), tip(0, -1)], [tip(0, -1), tip(1, -1)], [tip(1, -1), tip(0, 1)]]) {
      const shade = colour.map((part, k) => (k < 3 ? part * (up > 0 ? 1 : 0.75) : part));
      solid.push(...a, ...shade, ...b, ...shade, ...tip(2, up), ...shade);
    }
  }
}

function path(thin, trail, colour) {
  for (let k = 1; k < trail.length; k++) {
    if (trail[k][0] - trail[k - 1][0] > 2) continue;
    const age = (trail.length - k) / trail.length;
    segment(thin, trail[k - 1].slice(1, 4), trail[k].slice(1, 4), [...colour.slice(0, 3), 1 - 0.75 * age], 2.2);
  }
}

function barrier(thin, fence, paint) {
  const at = (k, z) => [fence.radius * Math.cos(k * Math.PI / 24), fence.radius * Math.sin(k * Math.PI / 24), z];
  for (let k = 0; k < 48; k++) {
    for (const z of [0.002, fence.height]) segment(thin, at(k, z), at(k + 1, z), paint("--fence", 0.55), 1.2);
    if (k % 6 === 0) segment(thin, at(k, 0), at(k, fence.height), paint("--fence", 0.3), 1);
  }
}

function beam(thin, frustum, colour) {
  const faint = [...colour.slice(0, 3), 0.35], {apex, image, ground: floor} = frustum;
  image.forEach((corner, k) => {
    segment(thin, corner, image[(k + 1) % 4], colour, 1.5);
    segment(thin, apex, corner, colour, 1.2);
    segment(thin, corner, floor[k * floor.length / 4], faint, 1);
  });
  floor.forEach((point, k) => segment(thin, point, floor[(k + 1) % floor.length], faint, 1.2));
}

function segment(lines, from, to, colour, wide) { lines.push([from, to, colour, wide]); }

function quad(faces, a, b, c, d, colour) {
  faces.push(...a, ...colour, ...b, ...colour, ...c, ...colour, ...a, ...colour, ...c, ...colour, ...d, ...colour);
}

// -- small mathematics and WebGL ----------------------------------------------------------------------------------------

function cross(a, b) { return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]; }

function multiply(a, b) {
  const product = new Array(16).fill(0);
  for (let k = 0; k < 4; k++) for (let j = 0; j < 4; j++) for (let i = 0; i < 4; i++) product[k * 4 + j] += a[i * 4 + j] * b[k * 4 + i];
  return product;
}

function palette() {
  const style = getComputedStyle(document.documentElement);
  return (name, alpha = 1) => {
    const hex = style.getPropertyValue(name).trim().replace(/^#(.)(.)(.)$/, "#$1$1$2$2$3$3");
    return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255).concat(alpha);
  };
}

function css(colour) { return `rgb(${colour.slice(0, 3).map((part) => Math.round(part * 255)).join(",")})`; }

function program(gl, vertices, fragments) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertices], [gl.FRAGMENT_SHADER, fragments]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}
