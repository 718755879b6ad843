// The curves of the metrics over time, as SVG.

function element(name, attributes, text) {
  const own = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) own.setAttribute(key, value);
  if (text !== undefined) own.textContent = text;
  return own;
}

// Round numbers between two bounds: about `count` of them.
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const first = Math.ceil(low / step);
  const all = Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) => (first + i) * step);
  return all.map((value) => Number(value.toPrecision(6)));
}

// Powers of ten between two bounds, with 2 and 5 times them where these are few.
function decades(low, high) {
  const all = [];
  for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power++) {
    for (const factor of [1, 2, 5]) all.push(Number((factor * 10 ** power).toPrecision(3)));
  }
  const inside = all.filter((value) => value >= low && value <= high);
  // Within less than a factor of 2, there are none.
  if (inside.length < 2) return ticks(low, high, 4);
  return inside.length > 7 ? inside.filter((value) => Number.isInteger(Math.log10(value))) : inside;
}

function drawCurve({ name, unit, logarithmic, points }) {
  const [width, height, left, bottom, top] = [360, 220, 48, 34, 24];
  const xs = points.map(([x]) => x);
  const ys = points.map(([, y]) => y);
  const [x0, x1] = [Math.min(0, ...xs), Math.max(...xs) || 1];
  let [y0, y1] = [Math.min(...ys), Math.max(...ys)];
  // Means of equal numbers differ by rounding.
  if (y1 - y0 <= 1e-9 * Math.abs(y1)) [y0, y1] = logarithmic ? [y0 / 2, y1 * 2] : [y0 - 1, y1 + 1];
  const scale = logarithmic ? Math.log : (y) => y;
  const x = (value) => left + ((value - x0) / (x1 - x0)) * (width - left - 8);
  const y = (value) => {
    const part = (scale(value) - scale(y0)) / (scale(y1) - scale(y0));
    return height - bottom - part * (height - bottom - top);
  };
  const label = unit ? `${name}, ${unit}` : name;
  const last = points[points.length - 1][1].toPrecision(3);
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${label} over seconds, at the end ${last}` });
  svg.append(element("text", { x: left, y: 14 }, label));
  for (const value of logarithmic ? decades(y0, y1) : ticks(y0, y1, 5)) {
    svg.append(element("path", { class: "axis", d: `M${left} ${y(value)}H${width - 8}` }));
    svg.append(element("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end" }, String(value)));
  }
  for (const value of ticks(x0, x1, 5)) {
    svg.append(element("text", { x: x(value), y: height - 18, "text-anchor": "middle" }, String(value)));
  }
  svg.append(element("text", { x: width - 8, y: height - 4, "text-anchor": "end" }, "seconds"));
  svg.append(element("path", { class: "axis", d: `M${left} ${top}V${height - bottom}H${width - 8}` }));
  const path = points.map(([a, b], i) => `${i ? "L" : "M"}${x(a).toFixed(1)} ${y(b).toFixed(1)}`);
  // The last part has no length: a curve of one point is a dot.
  svg.append(element("path", { class: "line", "stroke-linecap": "round", d: `${path.join("")}h0` }));
  return svg;
}

function showCurves() {
  const place = document.getElementById("curves");
  place.replaceChildren(...report.curves.map(drawCurve));
  if (!report.curves.length) place.textContent = report === nothing ? "There are no metrics yet." : "The run has no metrics.";
}

showCurves();
