// The window of one render.
const live = () => job && ["gathering", "loading", "rendering"].includes(job.phase);
async function follow() {
  const answer = await fetch("/api/jobs/1/stream", { headers: headers() });
  if (answer.status === 401) return askToken(sessionStorage.getItem("token"));
  if (!answer.ok) throw new Error(await why(answer));
  await readFrames(answer, () => {
    show();
    for (const id of ["cancel", "exr", "png"]) $(id).disabled = !live();
  });
}
const baseName = () => job.scene.replace(/\.[^.]*$/, "");
$("exr").onclick = () => save("/api/jobs/1/picture.exr", baseName() + ".exr");
$("png").onclick = () => save("/api/jobs/1/picture.png", baseName() + ".png");
$("cancel").onclick = async () => {
  if (!confirm("End the job? What is rendered so far is kept.")) return;
  const answer = await fetch("/api/jobs/1/cancel", { method: "POST", headers: headers() });
  $("note").textContent = answer.ok ? "ending" : await why(answer);
};
(async () => {
  for (;;) {
    try { await follow(); } catch (e) { $("note").textContent = e.message; }
    if (job && ["done", "failed", "ending"].includes(job.phase)) break;
    await wait(1000);
  }
})();
