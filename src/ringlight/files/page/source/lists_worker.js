// The worker: a camera comes in with empty buffers, ellipses and tile lists go back in them. Nothing is allocated for a
// picture, unless lists grow.
import { DepthOrder } from "./depth_order.js";
import { ELLIPSE, preparedScene, Projection } from "./projection.js";
import { TileLists } from "./tile_lists.js";

let projection, order;
const lists = new TileLists();

onmessage = ({ data }) => {
  if (data.scene) {
    const scene = preparedScene(data.scene);
    projection = new Projection(scene, data.options);
    order = new DepthOrder(scene.count);
    postMessage({ prepared: true });
    return;
  }
  const { camera, ellipses, tiles, most } = data,
    begun = performance.now();
  projection.project(camera);
  const projected = performance.now(),
    count = projection.count;
  const sorted = order.sort(projection.depths, count),
    ordered = performance.now();
  for (let place = 0; place < count; place++) {
    const from = ELLIPSE * sorted[place],
      to = ELLIPSE * place;
    for (let k = 0; k < ELLIPSE; k++) ellipses[to + k] = projection.ellipses[from + k];
  }
  const { side, across, down, total, entries } = lists.fill(ellipses, count, camera.size, most, tiles, data.entries);
  const times = { project: projected - begun, sort: ordered - projected, lists: performance.now() - ordered };
  postMessage({ camera, count, ellipses, tiles, entries, side, across, down, total, times }, [
    ellipses.buffer,
    tiles.buffer,
    entries.buffer,
  ]);
};
