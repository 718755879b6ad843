// The photograph, the render and the error of one view.

function showViews(viewer) {
  const get = (id) => document.getElementById(id);
  const [slider, wipe] = [get("view"), get("wipe")];
  const clip = () => {
    get("pair").style.setProperty("--line-at", `${wipe.value}%`);
  };
  const show = (i) => {
    const { views } = report;
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
  const step = (by) => show((Number(slider.value) + by + report.views.length) % report.views.length);
  slider.addEventListener("input", () => show(Number(slider.value)));
  wipe.addEventListener("input", clip);
  get("previous").addEventListener("click", () => step(-1));
  get("next").addEventListener("click", () => step(1));
  get("through").addEventListener("click", () => {
    viewer.orbit.through = report.views[Number(slider.value)].camera;
    viewer.redraw();
    get("surface").scrollIntoView({ block: "nearest" });
  });
  clip();
  // Shows the data of the page: the view that was shown, or the first.
  viewer.loadViews = () => {
    const count = report.views.length;
    get("views").hidden = !count;
    slider.max = Math.max(0, count - 1);
    if (count) show(Math.min(viewer.selected, count - 1));
  };
  viewer.loadViews();
}

showViews(viewer);
