// The news of a fit that goes on, from the program that serves the page.

{
  const get = (id) => document.getElementById(id);
  const token = new URLSearchParams(location.search).get("token") ?? "";
  const address = (path) => `${path}?token=${encodeURIComponent(token)}`;
  const [step, bar, stop] = [get("step"), get("progress"), get("stop")];
  let [shown, loaded, ended, quietUntil] = [0, Promise.resolve(), false, 0];

  const say = (text) => {
    if (Date.now() > quietUntil) step.textContent = text;
  };

  // Says what the next news shall not hide at once.
  const insist = (text) => {
    quietUntil = 0;
    say(text);
    quietUntil = Date.now() + 6000;
  };

  const show = ({ scene, verdict, html }) => {
    report = scene;
    viewer.load();
    viewer.loadViews();
    showCurves();
    get("verdict").className = `verdict ${verdict.state}`;
    get("verdict-text").textContent = verdict.text;
    for (const [id, fragment] of Object.entries(html)) get(id).innerHTML = fragment;
  };

  // Loads the newest surface, one load after the other.
  const load = (wanted) => {
    loaded = loaded.then(async () => {
      if (wanted === shown) return;
      const answer = await fetch(address("scene"));
      if (!answer.ok) return;
      const scene = await answer.json();
      shown = Number(answer.headers.get("dsdf-version"));
      show(scene);
    }).catch(() => {}); // The news tell again what there is.
    return loaded;
  };

  const news = new EventSource(address("news"));
  news.onmessage = async (event) => {
    const now = JSON.parse(event.data);
    bar.value = now.fraction;
    say([now.step, now.times, now.text].filter((text) => text).join(" · "));
    ended = now.state !== "running";
    stop.disabled = ended || now.stops;
    if (now.stops && !ended) say("The fit stops: it writes a checkpoint.");
    if (ended) insist(now.text);
    await load(now.version);
    const isLive = get("verdict").classList.contains("live");
    if (ended && isLive && !get("verdict-text").textContent.includes("was stopped")) {
      get("verdict").className = now.state === "failed" ? "verdict fault" : "verdict live";
      get("verdict-text").textContent = now.text;
    }
    // The program waits for its pages.
    if (ended) news.close();
  };
  news.onerror = () => {
    if (ended) return;
    stop.disabled = true;
    say(news.readyState === EventSource.CLOSED
      ? "This address has ended, or its token is wrong: the program prints the address of its page."
      : "No answer: the program was stopped, or this computer slept. The page tries again.");
    // A browser gives up after an answer that is no stream of news.
    if (news.readyState === EventSource.CLOSED) setTimeout(() => location.reload(), 5000);
  };
  stop.addEventListener("click", async () => {
    stop.disabled = true;
    const answer = await fetch(address("stop"), { method: "POST" }).catch(() => null);
    if (!answer?.ok) {
      stop.disabled = false;
      insist(answer ? await answer.text() : "No answer: the program was stopped.");
    }
  });
}
