"use strict";
// The picture: linear floats, toned by the browser; zoom, exposure, values of pixels.
const $ = id => document.getElementById(id);
const headers = () => ({ Authorization: "Bearer " + (sessionStorage.getItem("token") || ""), "X-Cloudrenderer": "1" });

let width = 0, height = 0, linear = new Float32Array(0), toned = null;
const offscreen = document.createElement("canvas"), ink = offscreen.getContext("2d");
const view = $("view"), paint = view.getContext("2d");
let zoom = 0, panX = 0, panY = 0;  // zoom 0: fit
const srgb = Uint8ClampedArray.from({ length: 4097 }, (_, i) => {
  const x = i / 4096;
  return 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * Math.pow(x, 1 / 2.4) - 0.055) + 0.5;
});
function clearPicture() {
  width = height = 0;
  zoom = panX = panY = 0;
  $("pixel").textContent = "";
  draw();
}
function resize(w, h) {
  if (w === width && h === height) return;
  clearPicture();
  width = offscreen.width = w;
  height = offscreen.height = h;
  linear = new Float32Array(3 * w * h);
  toned = ink.createImageData(w, h);
  for (let i = 3; i < toned.data.length; i += 4) toned.data[i] = 255;
}
function tone(x0, y0, w, h) {
  const gain = 4096 * Math.pow(2, +$("exposure").value);
  for (let y = y0; y < y0 + h; ++y)
    for (let x = x0; x < x0 + w; ++x) {
      const p = y * width + x;
      for (let c = 0; c < 3; ++c) toned.data[4 * p + c] = srgb[Math.min(4096, linear[3 * p + c] * gain) | 0];
    }
  ink.putImageData(toned, 0, 0, x0, y0, w, h);
}
const wordsOf = body => new DataView(body.buffer, body.byteOffset, body.byteLength);
function unpack(bits, p) {
  const unit = Math.pow(2, (bits >>> 27) - 24);
  linear[p] = (bits & 511) * unit;
  linear[p + 1] = (bits >>> 9 & 511) * unit;
  linear[p + 2] = (bits >>> 18 & 511) * unit;
}
// All of the picture in squares, to be replaced by tiles.
function takeCoarse(body) {
  const words = wordsOf(body), [step, w] = [0, 4].map(at => words.getUint32(at, true));
  for (let y = 0, p = 0; y < height; ++y)
    for (let x = 0; x < width; ++x, p += 3)
      unpack(words.getUint32(12 + 4 * (Math.floor(y / step) * w + Math.floor(x / step)), true), p);
  tone(0, 0, width, height);
}
function takeTile(body) {
  const words = wordsOf(body);
  const [x0, y0, w, h] = [0, 4, 8, 12].map(at => words.getUint32(at, true));
  if (x0 + w > width || y0 + h > height) return;
  for (let y = 0, at = 20; y < h; ++y)
    for (let x = 0; x < w; ++x, at += 4) unpack(words.getUint32(at, true), 3 * ((y0 + y) * width + x0 + x));
  tone(x0, y0, w, h);
}
const scale = () => zoom || Math.min(view.width / width, view.height / height);
let drawing = false;
function draw() {
  if (drawing) return;
  drawing = true;
  requestAnimationFrame(() => {
    drawing = false;
    view.width = view.clientWidth * devicePixelRatio;
    view.height = view.clientHeight * devicePixelRatio;
    if (!width) return;
    const s = scale();
    paint.imageSmoothingEnabled = s < 1;
    paint.setTransform(s, 0, 0, s, view.width / 2 - s * (width / 2 - panX), view.height / 2 - s * (height / 2 - panY));
    paint.drawImage(offscreen, 0, 0);
  });
}
function under(event) {
  const r = view.getBoundingClientRect(), s = scale();
  return [Math.floor(((event.clientX - r.left) * devicePixelRatio - view.width / 2) / s + width / 2 - panX),
          Math.floor(((event.clientY - r.top) * devicePixelRatio - view.height / 2) / s + height / 2 - panY)];
}
view.addEventListener("pointermove", e => {
  if (!width) return;
  if (e.buttons & 1) {
    panX += e.movementX * devicePixelRatio / scale();
    panY += e.movementY * devicePixelRatio / scale();
    draw();
  }
  const [x, y] = under(e), inside = x >= 0 && y >= 0 && x < width && y < height;
  $("pixel").textContent = inside
    ? `x ${x}  y ${y}   ` + [0, 1, 2].map(c => linear[3 * (y * width + x) + c].toPrecision(4)).join("  ") : "";
});
view.addEventListener("pointerdown", e => view.setPointerCapture(e.pointerId));
view.addEventListener("wheel", e => {
  e.preventDefault();
  const [x, y] = under(e), before = scale();
  zoom = Math.min(64, Math.max(0.05, before * Math.pow(1.0015, -e.deltaY)));
  panX = (panX - width / 2 + x) * before / zoom + width / 2 - x;
  panY = (panY - height / 2 + y) * before / zoom + height / 2 - y;
  draw();
}, { passive: false });
$("fit").onclick = () => { zoom = panX = panY = 0; draw(); };
$("one").onclick = () => { zoom = 1; panX = panY = 0; draw(); };
$("exposure").oninput = () => {
  $("stops").textContent = $("exposure").value;
  if (width) tone(0, 0, width, height);
  draw();
};
addEventListener("resize", draw);
