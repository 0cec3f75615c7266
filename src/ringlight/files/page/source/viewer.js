// From what is wished to be seen to pictures: one camera at a time is with the worker, and the picture that is drawn is
// always that of the lists that came back. While it moves, pictures are as fine as time allows; at rest they are whole.
const REST = 160; // milliseconds without a change after which the whole picture is made
const SLOW = 45,
  FAST = 22; // milliseconds between two pictures of a moving camera
const COARSEST = 0.25,
  COARSER = 0.8,
  FINER = 1.1;

export class Viewer {
  constructor(picture, worker, wished) {
    Object.assign(this, { picture, worker, wished });
    this.spare = picture.buffers();
    this.scale = 1;
    this.changed = -Infinity;
    this.waiting = [];
    this.answers = [];
    worker.onerror = (event) => this.fail(new Error(event.message));
    worker.onmessage = ({ data }) => {
      try {
        this.arrived(data);
      } catch (error) {
        this.fail(error);
      }
    };
    this.look = { layer: "picture", residual: 1, background: picture.facts.background, pack: 0, blend: 0 };
  }

  // Something is to be seen otherwise. With `moving` more of it will follow.
  change(moving = true) {
    this.changed = moving ? performance.now() : -Infinity;
    this.asked = true;
    this.schedule();
  }

  // Resolves when an exact picture of all that was wished until now has been drawn; rejects where none can be.
  settled() {
    return new Promise((resolve, reject) => {
      if (this.failure) return reject(this.failure);
      this.waiting.push({ resolve, reject });
      this.change(false);
    });
  }

  // Nothing can be drawn any more: `onfailure` says so to the person, whoever waits hears it.
  fail(error) {
    this.failure = error;
    this.onfailure?.(error);
    for (const { reject } of [...this.answers, ...this.waiting.splice(0)]) reject(error);
  }

  // After a failure: a new `picture` can draw again.
  goOn(picture) {
    Object.assign(this, { picture, failure: null });
    this.change(false);
  }

  schedule() {
    if (this.planned) return;
    this.planned = true;
    requestAnimationFrame(() => {
      this.planned = false;
      this.step();
    });
  }

  step() {
    if (!this.spare || this.failure) return; // the worker is at work, and its answer goes on
    const moving = performance.now() - this.changed < REST;
    if (!this.asked && !(this.coarse && !moving)) {
      if (this.coarse) this.schedule();
      return;
    }
    this.asked = false;
    this.coarse = moving;
    this.begun = performance.now();
    const { ellipses, tiles, entries } = this.spare,
      camera = this.wished(moving ? this.scale : 1);
    this.spare = null;
    this.answers = moving ? [] : this.waiting.splice(0); // who waits gets a whole picture, also if it moves on
    this.worker.postMessage({ camera, ellipses, tiles, entries, most: this.picture.most }, [
      ellipses.buffer,
      tiles.buffer,
      entries.buffer,
    ]);
  }

  arrived(lists) {
    if (lists.prepared) return;
    this.spare = lists;
    if (this.failure) return;
    this.picture.load(lists);
    this.times = lists.times;
    const exact = this.picture.draw({ ...this.look, some: this.coarse });
    if (!exact) this.asked = true;
    if (this.coarse) this.keepTime();
    for (const { resolve } of this.answers) resolve();
    this.onpicture?.(this.coarse);
    this.schedule();
  }

  // The time of the last picture in full counts, the graphics card's part of it as well: the next frame comes after it.
  keepTime() {
    const begun = this.begun;
    requestAnimationFrame(() => {
      const took = performance.now() - begun;
      if (took > SLOW) this.scale = Math.max(this.scale * COARSER, COARSEST);
      else if (took < FAST) this.scale = Math.min(this.scale * FINER, 1);
    });
  }
}
