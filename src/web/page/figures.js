// What there is to know of a render: figures, error over time, hosts, who holds what.
let job = null, cost = false;
const text = s => document.createTextNode(s);
function element(name, content, attributes = {}) {
  const e = document.createElement(name);
  for (const [k, v] of Object.entries(attributes)) e.setAttribute(k, v);
  for (const c of [content].flat()) e.append(typeof c === "object" ? c : text(String(c)));
  return e;
}
const seconds = s => s < 100 ? s.toFixed(1) + " s" : s < 6000 ? (s / 60).toFixed(1) + " min" : (s / 3600).toFixed(1) + " h";
const small = n => n < 1e-3 ? n.toExponential(1) : n.toPrecision(2);
const many = (n, what) => n.toLocaleString("en") + " " + what + (n === 1 ? "" : "s");
const bytes = n => {
  const i = n > 0 ? Math.min(4, Math.floor(Math.log2(n) / 10)) : 0;
  return (n / Math.pow(1024, i)).toFixed(i ? 1 : 0) + " " + ["B", "KiB", "MiB", "GiB", "TiB"][i];
};
function list(id, rows) {
  $(id).replaceChildren(...rows.flatMap(([k, v]) => [element("dt", k), element("dd", v)]));
}
function bar(share) {
  return element("span", element("i", "", { style: `width:${Math.round(100 * Math.min(1, share))}%` }), { class: "cell" });
}
function chart() {
  const points = job.history.filter(p => p[4] > 0 && p[cost ? 2 : 0] > 0).map(p => [p[cost ? 2 : 0], p[4]]);
  const svg = $("chart"), left = 44, right = 380, top = 8, bottom = 108;
  svg.replaceChildren();
  if (points.length < 2) return svg.append(Object.assign(mark("text", { x: 8, y: 60 }), { textContent: "after the first estimates" }));
  const range = k => {
    const all = points.map(p => Math.log10(p[k])), low = Math.min(...all), high = Math.max(...all);
    return [low, Math.max(high, low + 0.1)];
  };
  const [x0, x1] = range(0), [y0, y1] = range(1);
  const X = v => left + (Math.log10(v) - x0) / (x1 - x0) * (right - left), Y = v => bottom - (Math.log10(v) - y0) / (y1 - y0) * (bottom - top);
  for (const [v, y] of [[Math.pow(10, y0), bottom], [Math.pow(10, y1), top]]) {
    svg.append(mark("line", { x1: left, x2: right, y1: y, y2: y }));
    svg.append(Object.assign(mark("text", { x: 2, y: y + 3 }), { textContent: small(v) }));
  }
  for (const [v, anchor] of [[Math.pow(10, x0), "start"], [Math.pow(10, x1), "end"]])
    svg.append(Object.assign(mark("text", { x: X(v), y: 124, "text-anchor": anchor }), { textContent: v.toPrecision(3) + (cost ? " host-seconds" : " s") }));
  svg.append(mark("path", { d: "M" + points.map(p => X(p[0]).toFixed(1) + " " + Y(p[1]).toFixed(1)).join("L") }));
}
function mark(name, attributes) {
  const e = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [k, v] of Object.entries(attributes)) e.setAttribute(k, v);
  return e;
}
function partMap() {
  const there = job.hosts.filter(h => h.left_s === null), map = $("map");
  $("maps").hidden = !there.some(h => h.parts.length);
  const rows = Math.max(1, there.length), row = Math.max(3, Math.min(14, Math.floor(240 / rows)));
  const parts = Math.max(1, job.parts - 1);  // part 0, the main scene, is everybody's
  map.width = parts;
  map.height = rows;
  map.style.height = rows * row + "px";
  const pen = map.getContext("2d");
  there.forEach((h, y) => {
    pen.fillStyle = `hsl(${(h.id * 137) % 360} 45% 62%)`;
    for (const p of h.parts) if (p > 0) pen.fillRect(p - 1, y, 1, 1);
  });
  const copies = new Uint32Array(job.parts);
  for (const h of there) for (const p of h.parts) if (p > 0) ++copies[p];
  const held = [...copies].filter(n => n > 0).length;
  $("mapnote").textContent = `${many(parts, "part")} across, a row a host; ${held} held, ${[...copies].filter(n => n > 1).length} more than once`;
}
function show(title = job.scene) {
  resize(job.width, job.height);
  $("scene").textContent = title;
  document.title = title + " – cloudrenderer";
  const share = job.paths_total ? job.paths_done / job.paths_total : 0;
  const left = job.phase === "rendering" && share > 0.01 ? ", about " + seconds(job.render_s * (1 - share) / share) + " left" : "";
  $("phase").textContent = job.phase + (job.waiting_for ? ": " + job.waiting_for : "") + left;
  $("done").style.width = 100 * share + "%";
  list("facts", facts());
  $("hosts").replaceChildren(...job.hosts.map(h => element("tr", [
    element("td", h.name + (h.lost ? " (lost)" : ""), { title: h.name }), element("td", h.threads), element("td", bar(h.busy)),
    element("td", [bar(h.memory_budget ? h.memory_used / h.memory_budget : 0), " " + bytes(h.memory_used)]),
    element("td", h.parts_loaded ?? h.parts.length), element("td", bytes(h.bytes_sent))],
    { class: (h.left_s !== null ? "gone " : "") + (h.lost ? "lost" : "") })));
  list("tasks", Object.entries(job.tasks));
  $("states").hidden = !Object.keys(job.tasks).length;
  chart();
  partMap();
}
function facts() {
  const pixels = job.width * job.height;
  return [
    ["picture", `${job.width} x ${job.height}`],
    ["samples a pixel", `${(job.paths_done / pixels).toFixed(1)} of ${job.spp}`],
    ["estimated relMSE", !job.estimated_relmse ? "–"
      : `${small(job.estimated_relmse)} (${small(job.estimated_relmse_low)} to ${small(job.estimated_relmse_high)})`],
    ["samples a second", job.render_s > 0 ? (job.paths_done / job.render_s / 1e6).toFixed(2) + " M" : "–"],
    ["time", seconds(job.elapsed_s)],
    ["cost", `${seconds(job.host_s)} of hosts, ${seconds(job.cpu_s)} of processors`],
    ["scene", job.parts ? `${many(Math.max(1, job.parts - 1), "part")}, ${many(job.triangles, "triangle")}` : "–"],
    ["same bits everywhere", job.bit_exact ? "yes" : "no"]];
}
$("swap").onclick = () => {
  cost = !cost;
  $("over").textContent = cost ? "cost" : "time";
  $("swap").textContent = cost ? "time" : "cost";
  if (job) chart();
};

// ---- what both drivers need ------------------------------------------------------------------------------------------
function askToken(refused) {
  return new Promise(done => {
    $("refused").hidden = !refused;
    $("token").value = "";
    $("ask").onclose = () => { sessionStorage.setItem("token", $("token").value); done(); };
    if (!$("ask").open) $("ask").showModal();
  });
}
async function why(answer) {
  try { return (await answer.json()).error; } catch { return "the answer is " + answer.status; }
}
// Reads a stream of frames (src/web/README.md) to its end.
async function readFrames(answer, seen) {
  const reader = answer.body.getReader();
  let held = new Uint8Array(0);
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const all = new Uint8Array(held.length + value.length);
    all.set(held);
    all.set(value, held.length);
    let at = 0;
    while (all.length - at >= 4) {
      const n = new DataView(all.buffer, at).getUint32(0, true);
      if (all.length - at < 4 + n) break;
      const body = all.subarray(at + 5, at + 4 + n);
      if (all[at + 4] === 1) { job = JSON.parse(new TextDecoder().decode(body)); seen(); }
      else if (width) (all[at + 4] === 3 ? takeCoarse : takeTile)(body);
      at += 4 + n;
    }
    held = all.slice(at);
    draw();
  }
}
// Files are fetched by the page, since only it has the token.
async function save(url, name) {
  const answer = await fetch(url, { headers: headers() });
  if (!answer.ok) return void ($("note").textContent = await why(answer));
  const link = element("a", "", { href: URL.createObjectURL(await answer.blob()), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}
const wait = ms => new Promise(next => setTimeout(next, ms));
