// Cameras that have a name: "home", and those that the model was trained with.
import { cameraOf } from "./camera.js";

export function stopsOf({ parts, facts }) {
  const stops = new Map([["home", cameraOf(facts.home.pose, facts.home.focal, facts.home.center, facts.home.size)]]);
  const { values } = parts.get("cameras")[""];
  facts.cameraNames.forEach((name, number) => {
    const row = Array.from(values.subarray(18 * number, 18 * number + 18));
    stops.set(name, cameraOf(row.slice(0, 12), row.slice(12, 14), row.slice(14, 16), row.slice(16, 18)));
  });
  return stops;
}
