// Run in a shared page by `ringlight bench page`; functions only, each called by itself.

// When the first exact picture was there, milliseconds after the page was asked for.
async function first() {
  const found = await window.ringlight?.ready;
  if (!found) return null;
  const { facts } = found;
  const told = { kind: facts?.kind ?? null, texels: facts ? texelsOf(facts) : null };
  return { ...told, still: found.still ?? null, milliseconds: window.firstPicture };
}

// Of channels that a Gaussian has: its colour; with an environment, normal and strength in another; or a mirror's base
// colour, normal, latents by four, and colour as seen.
function texelsOf({ kind, sizes }) {
  if (kind === "environment") return 2;
  return kind === "mirror" ? 2 + Math.ceil(sizes.LATENTS / 4) + (sizes.BASIS > 0) : 1;
}

// From another side each time; then the picture, its own time until a pixel of it can be read, and again with all
// colours made anew.
async function picture(turn) {
  window.ringlight.move((pose) => pose.turned(0.9 * turn, 0, [0, 0, 1], true));
  await window.ringlight.settled();
  const { viewer } = window.ringlight, { picture } = viewer, { gl } = picture, pixel = new Uint8Array(4);
  const finish = () => gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  const timed = () => {
    const begun = performance.now();
    picture.draw({ ...viewer.look, some: false });
    finish();
    return performance.now() - begun;
  };
  finish(); // what settled() has drawn may still be at work
  const drawn = timed();
  picture.kind.colored?.forget();
  const recolored = timed();
  const { total, count, side } = picture.lists, { width, height } = picture.canvas;
  return { ...viewer.times, drawn, recolored, entries: total, seen: count, tile: side, width, height };
}

// What draws, in the browser's words.
function renderer() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return null;
  const told = gl.getExtension("WEBGL_debug_renderer_info");
  return gl.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
}

// Milliseconds to sort `count` depths in a worker that runs `modules`, the median of nine.
function sorted(modules, count) {
  const work = `${modules}
    const order = new $depth_order.DepthOrder(${count}), depths = new Float32Array(${count}), times = [];
    for (let turn = 0; turn < 9; turn++) {
      for (let k = 0; k < ${count}; k++) depths[k] = 1 + 5 * Math.random();
      const begun = performance.now();
      order.sort(depths, ${count});
      times.push(performance.now() - begun);
    }
    postMessage(times.sort((a, b) => a - b)[4]);`;
  const worker = new Worker(URL.createObjectURL(new Blob([work], { type: "text/javascript" })));
  return new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => resolve(data);
    worker.onerror = ({ message }) => reject(new Error(message));
  });
}
