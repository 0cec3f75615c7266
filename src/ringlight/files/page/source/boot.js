// The first script: inflates the rest of the program with the model's numbers, and starts it. The page's policy knows
// both scripts by their hashes.
import { setCaption } from "./caption.js";
import { fallBack } from "./fallback.js";
import { readPayload } from "./payload.js";

async function start() {
  const facts = JSON.parse(document.getElementById("facts").textContent);
  setCaption(facts.caption);
  if (!window.DecompressionStream) throw new Error("it cannot inflate");
  const payload = await readPayload(document.getElementById("payload"));
  const program = document.createElement("script");
  program.textContent = payload.texts["main.js"];
  document.body.append(program);
  return window.ringlight.begin(facts, payload);
}

window.ringlight = {};
window.ringlight.ready = start().catch((error) => {
  fallBack(error.message);
  return { still: error.message };
});
