"use strict";
// What needs a hand on the page: curtains between photograph and picture, and values under the pointer. Without it the
// page shows the same pictures and lines side by side. Texts are set as text, never as HTML.

document.documentElement.classList.add("js");

function made(tag, where, className) {
  const one = document.createElement(tag);
  if (className) one.className = className;
  where.append(one);
  return one;
}

// ---- curtains: all of one view move together

for (const view of document.querySelectorAll(".view")) {
  const photograph = document.getElementById(view.dataset.key + "-photograph");
  const inputs = [];
  const cut = (percent) => {
    const held = Math.min(100, Math.max(0, percent));
    view.style.setProperty("--cut", held + "%");
    for (const input of inputs) input.value = held;
  };
  for (const curtain of view.querySelectorAll(".curtain")) {
    const over = made("img", curtain, "over");
    over.src = photograph.src;
    over.alt = "";
    over.draggable = false;
    curtain.querySelector("img").draggable = false;
    const input = made("input", curtain);
    input.type = "range";
    input.setAttribute("aria-label", "share of the photograph, percent");
    input.addEventListener("input", () => cut(Number(input.value)));
    inputs.push(input);
    made("span", curtain, "edge");
    const follow = (event) => {
      const box = curtain.getBoundingClientRect();
      cut((100 * (event.clientX - box.left)) / box.width);
    };
    curtain.addEventListener("pointerdown", (event) => {
      curtain.setPointerCapture(event.pointerId);
      follow(event);
    });
    curtain.addEventListener("pointermove", (event) => {
      if (curtain.hasPointerCapture(event.pointerId)) follow(event);
    });
  }
}

for (const select of document.querySelectorAll("select[data-for]")) {
  select.addEventListener("change", () => {
    for (const view of document.getElementById(select.dataset.for).querySelectorAll(".view")) {
      const source = document.getElementById(view.dataset.key + "-" + select.value);
      for (const over of view.querySelectorAll(".over")) over.src = source.src;
    }
  });
}

// ---- values under the pointer

const SVG = "http://www.w3.org/2000/svg";
const tip = made("div", document.body, "tip");
tip.hidden = true;

function nearest(values, x) {
  let best = values[0];
  for (const value of values) if (Math.abs(value[0] - x) < Math.abs(best[0] - x)) best = value;
  return best;
}

function place(svg, tag, attributes) {
  const one = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  svg.append(one);
  return one;
}

for (const svg of document.querySelectorAll(".chart")) {
  const frame = JSON.parse(svg.dataset.frame);
  const lines = [...svg.querySelectorAll("g[data-values]")].map((g) => ({
    label: g.dataset.label, kind: g.getAttribute("class"), values: JSON.parse(g.dataset.values),
  }));
  const across = (x) => frame.left + ((x - frame.first) / frame.span) * (frame.right - frame.left);
  const down = (y) => frame.bottom - ((y - frame.low) / (frame.high - frame.low)) * (frame.bottom - frame.top);
  let drawn = [];
  const clear = () => {
    for (const one of drawn) one.remove();
    drawn = [];
    tip.hidden = true;
  };
  svg.addEventListener("pointermove", (event) => {
    clear();
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const x = frame.first + ((point.x - frame.left) / (frame.right - frame.left)) * frame.span;
    const found = lines.map((line) => nearest(line.values, x));
    const at = found.reduce((a, b) => (Math.abs(b[0] - x) < Math.abs(a[0] - x) ? b : a))[0];
    drawn.push(place(svg, "line", { x1: across(at), x2: across(at), y1: frame.top, y2: frame.bottom, class: "cursor" }));
    tip.replaceChildren();
    const head = made("bdi", tip, "faint");
    head.textContent = frame.names.length ? frame.names[at] : at + " " + frame.x;
    lines.forEach((line, index) => {
      const [placed, value] = found[index];
      const dot = place(svg, "circle", { cx: across(placed), cy: down(value), r: 3.5, class: line.kind });
      drawn.push(dot);
      const row = made("div", tip);
      const label = made("span", row);
      made("i", label, "dot " + line.kind);
      made("bdi", label).textContent = line.label;
      made("span", row).textContent = String(value);
    });
    tip.hidden = false;
    const room = document.documentElement.clientWidth - tip.offsetWidth - 8;
    tip.style.left = Math.max(4, Math.min(event.pageX + 14, room)) + "px";
    tip.style.top = event.pageY + 16 + "px";
  });
  svg.addEventListener("pointerleave", clear);
}
