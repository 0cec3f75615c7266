// The page: draws the model, and listens.
import { addressOf, readAddress } from "./address.js";
import { cameraOf, fitted, Pose } from "./camera.js";
import { Controls } from "./controls.js";
import { fallBack } from "./fallback.js";
import { geometryOf, modelOf } from "./model.js";
import { Panel } from "./panel.js";
import { LAYERS, Picture } from "./picture.js";
import { stopsOf } from "./stops.js";
import { Viewer } from "./viewer.js";

const canvas = document.getElementById("picture");
const SHARPEST = 2; // canvas pixels for one of the page's, at most

async function begin(facts, payload) {
  const address = readAddress(location.hash);
  document.documentElement.classList.toggle("bare", address.bare);
  const model = modelOf(facts, payload),
    stops = stopsOf(model);
  const picture = new Picture(canvas, model.texts, model);
  const worker = new Worker(URL.createObjectURL(new Blob([model.texts["worker.js"]], { type: "text/javascript" })));
  worker.postMessage({
    scene: geometryOf(model),
    options: { antialiased: facts.antialiased, flipBelow: facts.flipBelow },
  });

  // Either a stored camera at its own size, or a pose that fills the window with the lens of `lens`.
  const state = { exact: null, pose: null, lens: stops.get("home") };
  const wished = (scale) => {
    const own = state.exact,
      size = own ? own.size : windowSize();
    canvas.style.width = own ? `${own.size[0]}px` : "100%";
    canvas.style.height = own ? `${own.size[1]}px` : "100%";
    const scaled = size.map((side) => Math.max(Math.round(side * scale), 1));
    if (own && scale === 1) return own;
    const { focal, center, size: lensSize } = state.lens;
    return fitted(cameraOf(state.pose.numbers(), focal, center, lensSize, state.pose.position), scaled);
  };
  const viewer = new Viewer(picture, worker, wished);
  viewer.onfailure = (error) => fallBack(error.message);
  let noted = 0;
  const note = () => {
    clearTimeout(noted);
    noted = setTimeout(() => history.replaceState(null, "", addressOf(state.pose, viewer.look, address.bare)), 300);
  };
  const stand = (name, own) => {
    const camera = stops.get(name) ?? stops.get("home");
    Object.assign(state, { exact: own ? camera : null, lens: camera, pose: Pose.of(camera, facts.center) });
    document.documentElement.classList.toggle("own-size", own);
    viewer.change(false);
  };
  const move = (change) => {
    document.documentElement.classList.remove("own-size");
    Object.assign(state, { exact: null, pose: change(state.pose) });
    viewer.change();
    note();
  };
  const look = (change) => {
    Object.assign(viewer.look, change);
    viewer.change();
  };
  const controls = new Controls(canvas, facts.up, move);
  const panel = new Panel(facts, stops, {
    viewed: (name) => stand(name, false),
    looked: look,
    flew: (flies) => (controls.flies = flies),
  });
  const follow = () => {
    const { view, at, layer, light, blend, pack } = readAddress(location.hash);
    if (LAYERS.includes(layer)) panel.layer(layer);
    if (light >= 0 && light <= 2 && light !== null) panel.fade(light);
    if (facts.lights?.[pack] && blend >= 0 && blend <= 1 && blend !== null) panel.blend(blend, pack);
    panel.show(stops.has(view) ? view : "home");
    stand(stops.has(view) ? view : "home", stops.has(view));
    if (at) state.pose = Pose.near(at.slice(0, 3), [at.slice(3, 6), at.slice(6, 9), at.slice(9, 12)], at[12]);
  };
  addEventListener("hashchange", () => {
    follow();
    viewer.change(false);
  });
  addEventListener("resize", () => viewer.change());
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault(); // else the browser never gives it back
    viewer.fail(new Error("the graphics card gave up"));
  });
  canvas.addEventListener("webglcontextrestored", () => {
    viewer.goOn(new Picture(canvas, model.texts, model));
    document.documentElement.classList.remove("still");
  });
  follow();
  await viewer.settled();
  document.documentElement.classList.add("drawn");
  return Object.assign(window.ringlight, {
    facts,
    viewer,
    move,
    look,
    stops: [...stops.keys()],
    view: (name) => (panel.show(name), stand(name, true), viewer.settled()),
    settled: () => viewer.settled(),
  });
}

function windowSize() {
  const sharp = Math.min(devicePixelRatio || 1, SHARPEST),
    box = document.getElementById("stage").getBoundingClientRect();
  return [box.width, box.height].map((side) => Math.max(Math.round(side * sharp), 1));
}

window.ringlight.begin = begin;
