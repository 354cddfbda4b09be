// The window of a service: the jobs of a user, and the frame that is looked at.
const rows = new Map(), cards = new Map();
let caller = null, currency = "", selected = null, chosen = null, clock = 0;
let looking = null;  // { job, frame, stop } of the frame's stream
let nudge = () => {};  // the row of the job that is looked at has changed
const ended = row => ["done", "failed", "cancelled"].includes(row.state);
const rank = row => ended(row) ? 2 : row.state === "running" ? 0 : 1;  // in the list
const amount = n => n.toFixed(n > 0 && n < 0.1 ? 4 : 2);
const money = (n, most) => amount(n) + (most === null ? "" : " of " + amount(most)) + (currency ? " " + currency : "");
const titleOf = row => row.name || row.file || "job " + row.id;

document.body.classList.add("service");
$("jobs").hidden = false;
$("logs").hidden = false;
for (const id of ["figures", "buttons", "leave"]) $(id).hidden = true;
$("scene").textContent = "";
$("cancel").textContent = "Cancel the job";
$("asked").textContent = "Your token for this service:";
$("enter").textContent = "Sign in";

// ---- the list --------------------------------------------------------------------------------------------------------
function timeLeft(row) {
  if (row.state !== "running" || row.progress < 0.01 || !row.started_at) return "";
  const gone = Date.now() / 1000 + clock - row.started_at;
  return gone > 0 ? "about " + seconds(gone * (1 - row.progress) / row.progress) + " left" : "";
}
function summary(row) {
  const said = [row.state === "running" && row.phase && row.phase !== "rendering" ? row.phase : row.state];
  const percent = Math.min(100 * row.progress, ended(row) ? 100 : 99.9);
  if (row.state !== "done" && percent > 0) said.push(percent.toFixed(percent < 10 ? 1 : 0) + " %");
  if (row.frames > 1) said.push(`${row.frame_states.done || 0} of ${row.frames} frames`);
  if (row.hosts && row.state === "running") said.push(row.hosts + (row.hosts === 1 ? " host" : " hosts"));
  if (row.estimated_relmse) said.push("relMSE " + small(row.estimated_relmse));
  if (timeLeft(row)) said.push(timeLeft(row));
  return said.join(" · ");
}
function costOf(row) {
  return currency ? money(row.cost, row.budget) : seconds(row.host_s) + " of hosts";
}
const costs = row => [...(currency ? [["cost", costOf(row)]] : []), ["hosts' time", seconds(row.host_s)], ["processors' time", seconds(row.cpu_s)]];
function card(row) {
  let c = cards.get(row.id);
  if (!c) {
    c = element("button", [
      element("span", [element("b", ""), element("span", "", { class: "name" }), element("span", "", { class: "cost" })], { class: "line" }),
      element("span", element("i", ""), { class: "track" }),
      element("span", "", { class: "sum" }), element("span", "", { class: "why" })], { class: "card" });
    c.onclick = () => { location.hash = "#" + row.id; };
    cards.set(row.id, c);
  }
  const put = (query, words) => { const e = c.querySelector(query); if (e.textContent !== words) e.textContent = words; };
  put("b", row.id);
  put(".name", titleOf(row) + (caller && caller.admin ? " – " + row.user : ""));
  c.querySelector(".name").title = titleOf(row);
  put(".cost", costOf(row));
  put(".sum", summary(row));
  put(".why", row.reason === row.state ? "" : row.reason);
  c.querySelector(".why").title = row.reason;
  c.querySelector("i").style.width = 100 * row.progress + "%";
  c.dataset.state = row.state;
  c.classList.toggle("selected", row.id === selected);
  c.setAttribute("aria-current", row.id === selected);
  return c;
}
let listing = false;
function showList() {
  if (listing) return;
  listing = true;
  requestAnimationFrame(() => {
    listing = false;
    const order = [...rows.values()].sort((a, b) => rank(a) - rank(b) || b.id - a.id).map(row => card(row));
    if (order.some((c, i) => $("joblist").children[i]?.firstChild !== c) || order.length !== $("joblist").children.length)
      $("joblist").replaceChildren(...order.map(c => element("li", c)));
    showJob();
  });
}
function take(line) {
  if (line.now) clock = line.now - Date.now() / 1000;
  if (line.caller) {
    caller = line.caller;
    $("leave").hidden = false;
    $("who").textContent = caller.name + (caller.admin ? ", who sees all" : "");
    rows.clear();
    cards.clear();
  }
  if (line.usage) {
    currency = line.usage.currency;
    const own = line.usage.users[0];
    $("spent").textContent = own ? "used: " + (currency ? money(own.cost, own.budget) + ", " : "") +
      seconds(own.cpu_s) + " of processors" : "";
  }
  if (line.hosts) {
    const h = line.hosts;
    $("poolsum").textContent = h.count ? `${h.count} ${h.count === 1 ? "host" : "hosts"}, ${h.threads} threads, ${bytes(h.memory_used)} of ${bytes(h.memory)}` : "no hosts";
    $("poolhosts").replaceChildren(...h.some.map(x => element("tr", [element("td", x.name), element("td", x.kind), element("td", x.threads),
      element("td", [bar(x.memory ? x.memory_used / x.memory : 0), " " + bytes(x.memory_used)])])));
  }
  for (const id of line.gone || []) { rows.delete(id); cards.delete(id); }
  for (const row of line.jobs || []) rows.set(row.id, row);
  if (selected === null && rows.size) select(Math.max(...[...rows.values()].filter(r => r.state === "running").map(r => r.id), 0) || Math.max(...rows.keys()));
  showList();
  nudge();
}
async function watch() {
  const answer = await fetch("/v1/watch", { headers: headers() });
  if (answer.status === 401) return askToken(sessionStorage.getItem("token"));
  if (!answer.ok) throw new Error(await why(answer));
  $("lost").hidden = true;
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  for (let held = ""; ;) {
    const { done, value } = await reader.read();
    if (done) throw new Error("The service has ended the connection");
    const lines = (held + value).split("\n");
    held = lines.pop();
    for (const line of lines) if (line) take(JSON.parse(line));
  }
}

// ---- the job that is looked at ---------------------------------------------------------------------------------------
const row = () => rows.get(selected);
function frameOf(r) {
  if (chosen !== null) return Math.min(chosen, r.frames - 1);
  if (looking && looking.job === r.id && (r.running.includes(looking.frame) || !r.running.length)) return looking.frame;
  return r.running.length ? r.running[0] : 0;
}
function select(id, frame = null) {
  selected = id;
  chosen = frame;
  $("note").textContent = "";
  showList();
}
function showJob() {
  const r = row();
  $("logs").disabled = !r;
  for (const id of ["exr", "png"]) $(id).disabled = !r || !job;
  $("cancel").disabled = !r || ended(r);
  $("resume").hidden = !r || !r.over_budget;
  $("prioritybox").hidden = !r || ended(r);
  if (r && document.activeElement !== $("priority")) $("priority").value = r.priority;
  $("framebar").hidden = !r || r.frames < 2;
  $("buttons").hidden = $("track").hidden = !r;
  if (!r) {
    forget();
    $("scene").textContent = rows.size ? "No such job" : "No jobs yet";
    $("phase").textContent = "";
    empty(rows.size ? "You have no job " + selected + "." : caller ? "cloudrenderer submit scene.pbrt\nsends a scene here." : "");
    return;
  }
  const frame = frameOf(r);
  if (!looking || looking.job !== r.id || looking.frame !== frame) look(r.id, frame);
  $("frames").textContent = "of " + r.frames;
  if (document.activeElement !== $("frame")) $("frame").value = frame;
  $("frame").max = r.frames - 1;
  $("framenote").textContent = Object.entries(r.frame_states).map(([state, n]) => n + " " + state).join(", ");
  if (!job) showRow(r);
  else $("phase").textContent = phrase(r);
}
// Why there is no figure: in words of the job.
function showRow(r) {
  $("scene").textContent = titleOf(r);
  document.title = titleOf(r) + " – cloudrenderer";
  $("phase").textContent = r.state;
  $("done").style.width = 100 * r.progress + "%";
  list("facts", [...costs(r), ["submitted", new Date(1000 * r.submitted_at).toLocaleString()], ["priority", r.priority]]);
  empty(r.reason || { checking: "The scene is being split.", queued: "Waits for its turn.", running: "A manager starts.", paused: "Stopped." }[r.state] || "There is no picture.");
}
function phrase(r) {
  const own = job && (job.phase === "done" || job.phase === "stopped") && r.state === "running" ? `frame ${looking.frame} is ${job.phase}` : "";
  const said = own || (job && r.state === "running" ? job.phase + (job.waiting_for ? ": " + job.waiting_for : "") : r.state + (r.reason && r.reason !== r.state ? ": " + r.reason : ""));
  const left = timeLeft(r);
  return said + (left ? ", " + left : "");
}
function empty(words) {
  $("empty").textContent = words;
  $("empty").hidden = !words;
  $("figures").hidden = !!words;
  if (words) $("bar").inert = true;
}
function forget() {
  if (looking) looking.stop.abort();
  looking = null;
  job = null;
  clearPicture();
  list("facts", []);
  $("done").style.width = 0;
}
function titleOfFrame(r) { return titleOf(r) + (r.frames > 1 ? ", frame " + looking.frame : ""); }
async function look(id, frame) {
  forget();
  const mine = looking = { job: id, frame, stop: new AbortController() };
  const path = `/v1/jobs/${id}/frames/${frame}`;
  while (looking === mine) {
    const known = JSON.stringify(rows.get(id)?.frame_states);
    let whole = false;
    try {
      const answer = await fetch(path + "/stream", { headers: headers(), signal: mine.stop.signal });
      if (answer.ok)
        await readFrames(answer, () => {
          const r = rows.get(id);
          if (!r || looking !== mine) return;
          empty("");
          $("bar").inert = false;
          show(titleOfFrame(r));
          showJob();
          // A pool's hosts work for others too: what the job has cost is what the meter says.
          list("facts", facts().flatMap(f => f[0] === "cost" ? costs(r) : [f]));
          whole = ["done", "stopped"].includes(job.phase);
        });
      else if (answer.status !== 404 && looking === mine) $("note").textContent = await why(answer);
    } catch { /* aborted, or the service is gone: the list says so */ }
    if (looking !== mine) return;
    // A whole picture changes only if the frame is rendered anew.
    await wait(1000);
    while (looking === mine && (whole || !rows.get(id)) && JSON.stringify(rows.get(id)?.frame_states) === known)
      await new Promise(next => { nudge = next; });
    while (looking === mine && !whole && rows.get(id) && ended(rows.get(id)) && JSON.stringify(rows.get(id).frame_states) === known)
      await new Promise(next => { nudge = next; });
  }
}
async function post(path, body, method = "POST") {
  const answer = await fetch(path, { method, headers: { ...headers(), "Content-Type": "application/json" }, body: JSON.stringify(body) });
  $("note").textContent = answer.ok ? "" : await why(answer);
}
$("cancel").onclick = () => confirm(`Cancel job ${selected}? Pictures that are done are kept.`) && post(`/v1/jobs/${selected}/cancel`, {});
$("resume").onclick = () => {
  const given = prompt("What may the job cost from now on, what it has cost included?", row().budget ?? "");
  if (given === null) return;
  if (given.trim() === "" || !isFinite(given)) return void ($("note").textContent = "a budget is a number");
  post(`/v1/jobs/${selected}/resume`, { budget: +given });
};
$("priority").onchange = async () => {
  if ($("priority").value !== "") await post(`/v1/jobs/${selected}`, { priority: +$("priority").value }, "PATCH");
  $("priority").value = row()?.priority;  // until the service says the new one
  $("priority").blur();
};
const picturePath = ending => `/v1/jobs/${looking.job}/frames/${looking.frame}/preview.${ending}`;
const pictureName = ending => titleOf(row()).replace(/\.pbrt$/, "").replace(/[^\w.-]+/g, "_") + (row().frames > 1 ? "-" + looking.frame : "") + "." + ending;
$("exr").onclick = () => looking && save(picturePath("exr"), pictureName("exr"));
$("png").onclick = () => looking && save(picturePath("png"), pictureName("png"));
$("logs").onclick = async () => {
  const text = async path => { const a = await fetch(path, { headers: headers() }); return a.ok ? a : null; };
  const [events, log] = await Promise.all([text(`/v1/jobs/${selected}/events`), text(`/v1/jobs/${selected}/frames/${looking.frame}/log`)]);
  const said = events ? (await events.json()).map(e => new Date(1000 * e.time).toLocaleString() + "  " + e.text) : [];
  $("logtitle").textContent = `job ${selected}`;
  $("logtext").textContent = said.join("\n") + (log ? `\n\nframe ${looking.frame}\n` + await log.text() : "");
  $("log").showModal();
};
const choose = n => { if (row()) location.hash = `#${selected}/${Math.max(0, Math.min(row().frames - 1, n))}`; };
$("before").onclick = () => choose(looking.frame - 1);
$("after").onclick = () => choose(looking.frame + 1);
$("frame").onchange = () => choose(Math.floor(+$("frame").value) || 0);
$("leave").onclick = () => { sessionStorage.removeItem("token"); location.reload(); };
function fromHash() {
  const [, id, frame] = location.hash.match(/^#(\d+)(?:\/(\d+))?$/) || [];
  if (id) select(+id, frame === undefined ? null : +frame);
}
addEventListener("hashchange", fromHash);
fromHash();
(async () => {
  for (;;) {
    try { await watch(); } catch (e) {
      $("lost").textContent = `The service cannot be reached; trying again. (${e.message})`;
      $("lost").hidden = false;
      await wait(1000);
    }
  }
})();
