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
  const model = modelOf(facts, payload),
    stops = stopsOf(model);
  const picture = new Picture(canvas, model.texts, model);
  const worker = new Worker(URL.createObjectURL(new Blob([model.texts["worker.js"]], { type: "text/javascript" })));
  worker.postMessage({
    scene: geometryOf(model),
    options: { antialiased: facts.antialiased, flipBelow: facts.flipBelow },
  });

  // Either a stored camera at its own size, or a pose that fills the window with the lens of `stop`.
  const state = { exact: null, pose: null, stop: "home", bare: false };
  const wished = (scale) => {
    const own = state.exact,
      size = own ? own.size : windowSize();
    canvas.style.width = own ? `${own.size[0]}px` : "100%";
    canvas.style.height = own ? `${own.size[1]}px` : "100%";
    const scaled = size.map((side) => Math.max(Math.round(side * scale), 1));
    if (own && scale === 1) return own;
    const { focal, center, size: lensSize } = stops.get(state.stop);
    return fitted(cameraOf(state.pose.numbers(), focal, center, lensSize, state.pose.position), scaled);
  };
  const viewer = new Viewer(picture, worker, wished);
  viewer.onfailure = (error) => fallBack(error.message);
  let noted = 0,
    follows = false; // the address, which says it already
  const note = () => {
    if (follows) return;
    clearTimeout(noted);
    noted = setTimeout(() => history.replaceState(null, "", addressOf(state, viewer.look)), 300);
  };
  const stand = (name, own) => {
    const stop = stops.has(name) ? name : "home",
      camera = stops.get(stop);
    Object.assign(state, { exact: own ? camera : null, stop, pose: Pose.of(camera, facts.center) });
    document.documentElement.classList.toggle("own-size", own);
    viewer.change(false);
    note();
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
    note();
  };
  const controls = new Controls(canvas, facts.up, move);
  const panel = new Panel(facts, stops, {
    viewed: (name) => stand(name, false),
    looked: look,
    flew: (flies) => (controls.flies = flies),
  });
  const follow = () => {
    const { view, at, lens, bare, layer, light, blend, pack } = readAddress(location.hash),
      named = at ? lens : view,
      stop = stops.has(named) ? named : "home",
      known = facts.lights?.[pack];
    clearTimeout(noted);
    follows = true;
    state.bare = bare;
    document.documentElement.classList.toggle("bare", bare);
    panel.layer(LAYERS.includes(layer) ? layer : "picture");
    panel.fade(light >= 0 && light <= 2 ? light : 1);
    panel.blend(known && blend >= 0 && blend <= 1 ? blend : 0, known ? pack : 0);
    panel.show(stop);
    stand(stop, !at && stops.has(named));
    if (at) state.pose = Pose.near(at.slice(0, 3), [at.slice(3, 6), at.slice(6, 9), at.slice(9, 12)], at[12]);
    follows = false;
  };
  addEventListener("hashchange", () => {
    follow();
    viewer.change(false);
  });
  addEventListener("resize", () => viewer.change());
  keepContext(viewer, () => new Picture(canvas, model.texts, model));
  follow();
  Object.assign(window.ringlight, {
    facts,
    viewer,
    move,
    look,
    stops: [...stops.keys()],
    view: (name) => (panel.show(name), stand(name, true), viewer.settled()),
    settled: () => viewer.settled(),
  });
  await shown(viewer);
  return window.ringlight;
}

// The browser may take the graphics card away, also before the first picture, and give it back with nothing on it.
function keepContext(viewer, anew) {
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault(); // else the browser never gives it back
    viewer.fail(new Error("the graphics card gave up"));
  });
  canvas.addEventListener("webglcontextrestored", async () => {
    try {
      viewer.goOn(anew());
      document.documentElement.classList.remove("still");
      await shown(viewer);
    } catch (error) {
      viewer.fail(error);
    }
  });
}

async function shown(viewer) {
  await viewer.settled();
  document.documentElement.classList.add("drawn");
}

function windowSize() {
  const sharp = Math.min(devicePixelRatio || 1, SHARPEST),
    box = document.getElementById("stage").getBoundingClientRect();
  return [box.width, box.height].map((side) => Math.max(Math.round(side * sharp), 1));
}

window.ringlight.begin = begin;
