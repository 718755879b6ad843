// The photograph, the render and the error of one view.

function showViews(viewer) {
  const get = (id) => document.getElementById(id);
  const { views } = report;
  if (!views.length) {
    get("views").hidden = true;
    return;
  }
  const [slider, wipe] = [get("view"), get("wipe")];
  slider.max = views.length - 1;
  const clip = () => {
    get("pair").style.setProperty("--line-at", `${wipe.value}%`);
  };
  const show = (i) => {
    const view = views[i];
    ["photograph", "render", "error"].forEach((id, kind) => {
      const image = get(id);
      image.src = "data:image/jpeg;base64," + view.pictures[kind];
      [image.width, image.height] = [view.width, view.height];
      image.alt = `${id[0].toUpperCase()}${id.slice(1)} of ${view.name}`;
    });
    const psnr = view.psnr === null ? "" : `, PSNR ${view.psnr.toFixed(1)} dB`;
    const use = view.held_out ? "held out" : "used in the fit";
    const text = `${i + 1} of ${views.length}: ${view.name}, ${use}${psnr}`;
    get("view-name").textContent = text;
    slider.value = i;
    slider.setAttribute("aria-valuetext", text);
    viewer.selected = i;
    viewer.redraw();
  };
  viewer.select = show;
  const step = (by) => show((Number(slider.value) + by + views.length) % views.length);
  slider.addEventListener("input", () => show(Number(slider.value)));
  wipe.addEventListener("input", clip);
  get("previous").addEventListener("click", () => step(-1));
  get("next").addEventListener("click", () => step(1));
  get("through").addEventListener("click", () => {
    viewer.orbit.through = views[Number(slider.value)].camera;
    viewer.redraw();
    get("surface").scrollIntoView({ block: "nearest" });
  });
  clip();
  show(0);
}

showViews(viewer);
