// The surface with the cameras around it, in WebGL 2.

// What a page shows as long as it has no data.
const nothing = { frame: { center: [0, 0, 0], radius: 1, up: [0, 0, 1] }, mesh: null, views: [], curves: [] };
let report = JSON.parse(document.getElementById("data").textContent) ?? nothing;

// Vectors are arrays of three numbers. Matrices have 16, column by column.
const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [0, 1, 2].map((i) => {
  const [j, k] = [(i + 1) % 3, (i + 2) % 3];
  return a[j] * b[k] - a[k] * b[j];
});
const unit = (a) => a.map((x) => x / (Math.hypot(...a) || 1));

// The matrix from world to camera coordinates: x right, y up, looking along −z.
function viewMatrix({ eye, right, up, forward }) {
  const back = forward.map((x) => -x);
  const rows = [right, up, back];
  const columns = [0, 1, 2].map((i) => [...rows.map((row) => row[i]), 0]);
  return [...columns.flat(), ...rows.map((row) => -dot(row, eye)), 1];
}

// The projection of the frustum with these tangents of its borders.
function projection([left, right, bottom, top], near, far) {
  const [w, h, d] = [right - left, top - bottom, near - far];
  return [
    2 / w, 0, 0, 0, 0, 2 / h, 0, 0,
    (right + left) / w, (top + bottom) / h, (far + near) / d, -1, 0, 0, (2 * far * near) / d, 0,
  ];
}

function product(a, b) {
  const entry = (i, j) => [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + i] * b[4 * j + k], 0);
  return Float32Array.from({ length: 16 }, (_, n) => entry(n % 4, Math.floor(n / 4)));
}

function bytes(text) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
}

const SURFACE_VERTEX = `#version 300 es
uniform mat4 matrix; uniform vec3 low, size;
in vec3 place, normal, color;
out vec3 n, c, x;
void main() {
  x = low + size * place; n = normal; c = color;
  gl_Position = matrix * vec4(x, 1);
}`;

const SURFACE_FRAGMENT = `#version 300 es
precision highp float;
uniform int mode; uniform vec3 eye;
in vec3 n, c, x;
out vec4 pixel;
void main() {
  vec3 unit = normalize(n), towards = normalize(eye - x);
  if (mode == 0) pixel = vec4(c, 1);
  else if (mode == 1) pixel = vec4(0.5 * unit + 0.5, 1);
  else pixel = vec4(vec3(0.15 + 0.75 * abs(dot(unit, towards))), 1);
  if (!gl_FrontFacing && dot(unit, towards) < 0.0) pixel.rgb *= 0.4;
}`;

const FLAT_VERTEX = `#version 300 es
uniform mat4 matrix;
in vec3 place; in vec2 corner;
out vec2 uv;
void main() { uv = corner; gl_Position = matrix * vec4(place, 1); }`;

const FLAT_FRAGMENT = `#version 300 es
precision mediump float;
uniform vec4 color; uniform sampler2D photograph;
in vec2 uv;
out vec4 pixel;
void main() { pixel = color.a > 0.0 ? color : texture(photograph, uv); }`;

// A program with its uniforms and attributes by name.
function program(gl, vertex, fragment) {
  const own = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(own, shader);
  }
  gl.linkProgram(own);
  if (!gl.getProgramParameter(own, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(own));
  return {
    own,
    uniform: (name) => gl.getUniformLocation(own, name),
    attribute: (name) => gl.getAttribLocation(own, name),
  };
}

// A buffer with this data.
function bufferOf(gl, kind, data) {
  const own = gl.createBuffer();
  gl.bindBuffer(kind, own);
  gl.bufferData(kind, data, gl.STATIC_DRAW);
  return own;
}

// A buffer of `count` numbers a vertex as the attribute `name`.
function attribute(gl, { attribute: place }, name, data, count, type, normalized) {
  const own = bufferOf(gl, gl.ARRAY_BUFFER, data);
  gl.enableVertexAttribArray(place(name));
  gl.vertexAttribPointer(place(name), count, type, normalized, 0, 0);
  return own;
}

function surfaceOf(gl, shader, mesh) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const buffers = [
    attribute(gl, shader, "place", bytes(mesh.positions), 3, gl.UNSIGNED_SHORT, true),
    attribute(gl, shader, "normal", bytes(mesh.normals), 3, gl.BYTE, true),
    attribute(gl, shader, "color", bytes(mesh.colors), 3, gl.UNSIGNED_BYTE, true),
    bufferOf(gl, gl.ELEMENT_ARRAY_BUFFER, bytes(mesh.indices)),
  ];
  return { mesh, arrays: [array], buffers, textures: [] };
}

// The pyramids of all cameras: eight lines each, and a quad with the photograph.
function camerasOf(gl, shader, views, length) {
  const [lines, quads, buffers] = [[], [], []];
  for (const { camera } of views) {
    const [left, right, bottom, top] = camera.borders;
    const corner = (x, y) =>
      add(add(add(camera.eye, camera.forward, length), camera.right, length * x), camera.up, length * y);
    const corners = [corner(left, bottom), corner(right, bottom), corner(right, top), corner(left, top)];
    corners.forEach((c, i) => lines.push(camera.eye, c, c, corners[(i + 1) % 4]));
    quads.push(corners[3], corners[0], corners[2], corners[1]);
  }
  const arrayOf = (points, uv) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    buffers.push(attribute(gl, shader, "place", new Float32Array(points.flat()), 3, gl.FLOAT, false));
    buffers.push(attribute(gl, shader, "corner", new Float32Array(uv), 2, gl.FLOAT, false));
    return array;
  };
  const corners = views.flatMap(() => [0, 0, 0, 1, 1, 0, 1, 1]);
  const arrays = [arrayOf(lines, new Array(lines.length * 2).fill(0)), arrayOf(quads, corners)];
  return { views, arrays, buffers, textures: views.map(() => null) };
}

// Gives the memory of a surface or of cameras back.
function dispose(gl, { arrays, buffers, textures }) {
  arrays.forEach((own) => gl.deleteVertexArray(own));
  buffers.forEach((own) => gl.deleteBuffer(own));
  textures.forEach((own) => gl.deleteTexture(own));
  textures.isGone = true;
}

function loadPhotographs(gl, { views, textures }, loaded) {
  views.forEach((view, i) => {
    const image = new Image();
    image.onload = () => {
      if (textures.isGone) return;
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, gl.RGB, gl.UNSIGNED_BYTE, image);
      gl.generateMipmap(gl.TEXTURE_2D);
      textures[i] = texture;
      loaded();
    };
    image.src = "data:image/jpeg;base64," + view.pictures[0];
  });
}

// The place from which the surface is seen: around the centre, or through a camera.
function orbitOf() {
  const orbit = { through: null };
  let [center, radius, up, reach, u, v, yaw, pitch] = [];
  const outwards = (yaw, pitch) => {
    const level = add(u.map((x) => x * Math.cos(yaw)), v, Math.sin(yaw));
    return add(level.map((x) => x * Math.cos(pitch)), up, Math.sin(pitch));
  };
  // The frame and the views that are looked at from now on, and the distance of the farthest camera.
  orbit.surround = (frame, views, farthest) => {
    ({ center, radius, up } = frame);
    reach = farthest;
    u = unit(cross(Math.abs(up[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0], up));
    v = cross(up, u);
    const directions = views.map(({ camera }) => unit(add(camera.eye, center, -1)));
    // Near the camera in the middle of those that look from one side, or else near the first, and as
    // far as can be from all: a camera would cover the surface.
    const mean = directions.reduce((sum, direction) => add(sum, direction), [0, 0, 0]);
    const isOneSided = dot(mean, mean) > (0.5 * directions.length) ** 2;
    const middle = (a, b) => (isOneSided && dot(b, mean) > dot(a, mean) ? b : a);
    const first = directions.length ? directions.reduce(middle) : u;
    pitch = Math.asin(Math.max(-0.9, Math.min(0.9, dot(first, up))));
    const around = Math.atan2(dot(first, v), dot(first, u));
    const nearest = (yaw) => Math.max(...directions.map((direction) => dot(direction, outwards(yaw, pitch))));
    const yaws = [0.4, 0.3, 0.2, 0.5, 0.6, -0.2, -0.3, -0.4, -0.5, -0.6].map((turn) => around + turn);
    yaw = yaws.reduce((best, other) => (nearest(other) < nearest(best) ? other : best));
  };
  orbit.reset = () => {
    [orbit.yaw, orbit.pitch] = [yaw, pitch];
    orbit.distance = 3.2 * radius;
    orbit.target = center;
    orbit.through = null;
  };
  // The tangent of half the field of view is 0.36.
  orbit.showAll = () => {
    orbit.reset();
    orbit.distance = 3.2 * Math.max(radius, reach);
  };
  orbit.turn = (yaw, pitch) => {
    orbit.through = null;
    orbit.yaw += yaw;
    orbit.pitch = Math.max(-1.55, Math.min(1.55, orbit.pitch + pitch));
  };
  orbit.zoom = (factor) => {
    orbit.through = null;
    orbit.distance = Math.max(0.05, Math.min(100, (orbit.distance * factor) / radius)) * radius;
  };
  orbit.move = (x, y) => {
    const { right, up: above } = orbit.frame();
    orbit.through = null;
    orbit.target = add(add(orbit.target, right, x * orbit.distance), above, y * orbit.distance);
  };
  orbit.frame = () => {
    if (orbit.through) return orbit.through;
    const out = outwards(orbit.yaw, orbit.pitch);
    const forward = out.map((x) => -x);
    const right = unit(cross(forward, up));
    const eye = add(orbit.target, out, orbit.distance);
    return { eye, right, up: cross(right, forward), forward, borders: [-0.36, 0.36, -0.36, 0.36] };
  };
  return orbit;
}

// Borders that hold those of a camera, with the shape of the canvas.
function fitted([left, right, bottom, top], aspect) {
  const [x, y] = [(left + right) / 2, (bottom + top) / 2];
  let [w, h] = [(right - left) / 2, (top - bottom) / 2];
  if (w < h * aspect) w = h * aspect;
  else h = w / aspect;
  return [x - w, x + w, y - h, y + h];
}

function viewerOf(canvas, message) {
  const orbit = orbitOf();
  const viewer = { mode: 0, showsCameras: true, selected: 0, orbit, select: () => {}, redraw: () => {} };
  const say = (text) => {
    message.textContent = text;
    message.hidden = !text;
  };
  const gl = canvas.getContext("webgl2", { antialias: true });
  let [surface, cameras, around, reach] = [null, null, "", 0];
  const shaders = gl && {
    surface: program(gl, SURFACE_VERTEX, SURFACE_FRAGMENT), flat: program(gl, FLAT_VERTEX, FLAT_FRAGMENT),
  };
  if (gl) canvas.addEventListener("webglcontextlost", () => say("The graphics card was lost: load the page again."));

  // Shows the data of the page, from where it was seen if the sphere is the same.
  viewer.load = () => {
    const { frame, mesh, views } = report;
    reach = Math.max(0, ...views.map(({ camera }) => Math.hypot(...add(camera.eye, frame.center, -1))));
    orbit.surround(frame, views, reach);
    const place = JSON.stringify([frame.center, frame.radius]);
    if (around !== place) orbit.reset();
    around = place;
    if (!gl) {
      say("This browser has no WebGL 2: the surface cannot be shown.");
      return;
    }
    if (report === nothing) say("There is no surface yet.");
    else say(mesh ? "" : "The run has no surface inside its bounding sphere.");
    [surface, cameras].filter((own) => own).forEach((own) => dispose(gl, own));
    surface = mesh && surfaceOf(gl, shaders.surface, mesh);
    cameras = camerasOf(gl, shaders.flat, views, 0.25 * frame.radius);
    loadPhotographs(gl, cameras, viewer.redraw);
    viewer.redraw();
  };
  if (!gl) {
    viewer.load();
    return viewer;
  }

  viewer.matrix = () => {
    const place = orbit.frame();
    const aspect = canvas.width / Math.max(1, canvas.height);
    const { center, radius } = report.frame;
    const far = Math.hypot(...add(place.eye, center, -1)) + reach + 2 * radius;
    return product(projection(fitted(place.borders, aspect), 0.0005 * far, far), viewMatrix(place));
  };
  const drawCameras = (matrix) => {
    const shader = shaders.flat;
    const { views, textures, arrays: [lines, quads] } = cameras;
    gl.useProgram(shader.own);
    gl.uniformMatrix4fv(shader.uniform("matrix"), false, matrix);
    const color = (r, g, b, a) => gl.uniform4f(shader.uniform("color"), r, g, b, a);
    const { forward } = orbit.frame();
    views.forEach((view, i) => {
      if (view.camera === orbit.through) return;
      // A photograph that is seen from behind its camera would hide the surface.
      if (textures[i] && dot(forward, view.camera.forward) < 0.6) {
        gl.bindVertexArray(quads);
        color(0, 0, 0, 0);
        gl.bindTexture(gl.TEXTURE_2D, textures[i]);
        gl.drawArrays(gl.TRIANGLE_STRIP, 4 * i, 4);
      }
      gl.bindVertexArray(lines);
      if (i === viewer.selected) color(0.95, 0.3, 0.1, 1);
      else if (view.held_out) color(0.2, 0.65, 0.35, 1);
      else color(0.35, 0.5, 0.8, 1);
      gl.drawArrays(gl.LINES, 16 * i, 16);
    });
  };
  viewer.draw = () => {
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const matrix = viewer.matrix();
    if (surface) {
      const shader = shaders.surface;
      const { mesh, arrays: [array] } = surface;
      gl.useProgram(shader.own);
      gl.uniformMatrix4fv(shader.uniform("matrix"), false, matrix);
      gl.uniform3fv(shader.uniform("low"), mesh.low);
      gl.uniform3fv(shader.uniform("size"), mesh.size);
      gl.uniform3fv(shader.uniform("eye"), orbit.frame().eye);
      gl.uniform1i(shader.uniform("mode"), viewer.mode);
      gl.bindVertexArray(array);
      gl.drawElements(gl.TRIANGLES, 3 * mesh.faces, gl.UNSIGNED_INT, 0);
    }
    if (viewer.showsCameras) drawCameras(matrix);
  };
  let due = false;
  viewer.redraw = () => {
    if (due) return;
    due = true;
    requestAnimationFrame(() => {
      due = false;
      viewer.draw();
    });
  };
  viewer.load();
  new ResizeObserver(() => {
    const scale = window.devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * scale));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * scale));
    viewer.draw(); // At once: a canvas of another size is empty.
  }).observe(canvas);
  return viewer;
}

const viewer = viewerOf(document.getElementById("surface"), document.getElementById("surface-message"));
