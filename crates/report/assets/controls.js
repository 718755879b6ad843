// The mouse, fingers, keys and buttons of the viewer.

function control(canvas, viewer) {
  const { orbit } = viewer;
  const changed = () => viewer.redraw();
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, length: Math.hypot(a.x - b.x, a.y - b.y) || 1 };
  };
  let moved = 0;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const before = pointers.size === 2 ? spread() : null;
    const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    moved += Math.abs(dx) + Math.abs(dy);
    const height = canvas.clientHeight;
    if (before) {
      const after = spread();
      orbit.zoom(before.length / after.length);
      orbit.move((0.72 * (before.x - after.x)) / height, (0.72 * (after.y - before.y)) / height);
    } else if (event.shiftKey || event.buttons === 2) {
      orbit.move((-0.72 * dx) / height, (0.72 * dy) / height);
    } else {
      orbit.turn((-4 * dx) / height, (4 * dy) / height);
    }
    changed();
  });
  const end = (event) => {
    if (event.type === "pointerup" && moved < 4 && pointers.size === 1) pick(canvas, viewer, event);
    pointers.delete(event.pointerId);
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    orbit.zoom(Math.exp(0.0015 * event.deltaY * (event.deltaMode ? 30 : 1)));
    changed();
  }, { passive: false });
  const modes = [...document.querySelectorAll("#modes input")];
  const cameras = document.getElementById("cameras");
  const show = (mode) => {
    modes[mode].checked = true;
    viewer.mode = mode;
  };
  const showCameras = (shown) => {
    cameras.checked = viewer.showsCameras = shown;
  };
  const all = () => {
    showCameras(true);
    orbit.showAll();
  };
  const keys = {
    ArrowLeft: () => orbit.turn(-0.1, 0), ArrowRight: () => orbit.turn(0.1, 0),
    ArrowUp: () => orbit.turn(0, 0.1), ArrowDown: () => orbit.turn(0, -0.1),
    "+": () => orbit.zoom(0.9), "=": () => orbit.zoom(0.9), "-": () => orbit.zoom(1 / 0.9),
    1: () => show(0), 2: () => show(1), 3: () => show(2),
    c: () => showCameras(!viewer.showsCameras), a: all, 0: () => orbit.reset(),
  };
  canvas.addEventListener("keydown", (event) => {
    const act = event.ctrlKey || event.metaKey || event.altKey ? null : keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
    changed();
  });
  modes.forEach((input, mode) => input.addEventListener("change", () => {
    show(mode);
    changed();
  }));
  cameras.addEventListener("change", () => {
    showCameras(cameras.checked);
    changed();
  });
  [["reset", orbit.reset], ["all", all]].forEach(([id, act]) => {
    document.getElementById(id).addEventListener("click", () => {
      act();
      changed();
    });
  });
}

// Selects the camera within 24 pixels of a click.
function pick(canvas, viewer, event) {
  if (!viewer.matrix || !viewer.showsCameras) return;
  const [matrix, box] = [viewer.matrix(), canvas.getBoundingClientRect()];
  const distance = ({ camera: { eye } }) => {
    const row = (i) => matrix[i] * eye[0] + matrix[4 + i] * eye[1] + matrix[8 + i] * eye[2] + matrix[12 + i];
    const w = row(3);
    if (w <= 0) return Infinity;
    const x = box.left + ((row(0) / w + 1) / 2) * box.width;
    const y = box.top + ((1 - row(1) / w) / 2) * box.height;
    return Math.hypot(x - event.clientX, y - event.clientY);
  };
  const all = report.views.map(distance);
  const nearest = all.indexOf(Math.min(...all));
  if (nearest >= 0 && all[nearest] < 24) viewer.select(nearest);
}

control(document.getElementById("surface"), viewer);
