// Hands on the picture: drag, wheel, pinch and keys become a new pose. One pointer turns, two or the right button move.
const TURN = 0.006,
  ZOOM = 0.0012; // radians a pixel; share of the distance a wheel's pixel
const FLY_SECONDS = 2.5; // to fly the distance of the subject
const TAP = 1 / 20, LONGEST = 0.1; // seconds that a tap counts, and a picture at most
const KEYS = {
  w: [0, 0, 1],
  s: [0, 0, -1],
  a: [-1, 0, 0],
  d: [1, 0, 0],
  q: [0, 1, 0],
  e: [0, -1, 0],
  arrowup: [0, 0, 1],
  arrowdown: [0, 0, -1],
  arrowleft: [-1, 0, 0],
  arrowright: [1, 0, 0],
};

export class Controls {
  // `moved(change)` is called with a function from the present pose to the next one.
  constructor(canvas, up, moved) {
    Object.assign(this, { canvas, up, moved, flies: false, pointers: new Map(), held: new Set() });
    canvas.addEventListener("pointerdown", (event) => this.pressed(event));
    canvas.addEventListener("pointermove", (event) => this.dragged(event));
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"])
      canvas.addEventListener(kind, (event) => this.released(event));
    canvas.addEventListener("wheel", (event) => this.wheeled(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    addEventListener("keydown", (event) => this.keyed(event, true));
    addEventListener("keyup", (event) => this.keyed(event, false));
    addEventListener("blur", () => this.held.clear());
  }

  pressed(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.moves = event.button === 2 || event.button === 1 || event.shiftKey;
  }

  released(event) {
    this.pointers.delete(event.pointerId);
  }

  dragged(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const old = [...this.pointers.values()];
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    const now = [...this.pointers.values()];
    const x = middle(now, 0) - middle(old, 0),
      y = middle(now, 1) - middle(old, 1);
    if (now.length === 1 && !this.moves) {
      const turned = this.flies ? -1 : 1;
      this.moved((pose) => pose.turned(-x * TURN * turned, y * TURN * turned, this.up, !this.flies));
      return;
    }
    const zoom = now.length > 1 ? spread(old) / Math.max(spread(now), 1) : 1;
    const share = 1 / this.canvas.clientHeight;
    this.moved((pose) => pose.moved(-x * share * pose.reach, -y * share * pose.reach, 0).nearer(zoom));
  }

  wheeled(event) {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : 1),
      factor = Math.exp(Math.max(Math.min(pixels, 400), -400) * ZOOM);
    this.moved((pose) => (this.flies ? pose.moved(0, 0, (1 - factor) * pose.reach) : pose.nearer(factor)));
  }

  keyed(event, down) {
    const key = event.key.toLowerCase();
    if (!down) this.held.delete(key); // whatever else is held by now
    if (!down || !KEYS[key] || event.ctrlKey || event.metaKey || event.altKey || takes(event.target, key)) return;
    event.preventDefault();
    if (!this.held.size) this.last = performance.now();
    if (!this.held.has(key)) {
      this.held.add(key);
      this.step(TAP); // however slow pictures are, a tap moves
    }
    this.fly();
  }

  // As long as keys are held.
  fly() {
    if (this.planned || !this.held.size) return;
    this.planned = true;
    requestAnimationFrame((now) => {
      this.planned = false;
      this.step(Math.min(Math.max(now - this.last, 0) / 1000, LONGEST));
      this.last = now;
      this.fly();
    });
  }

  // So many seconds of the keys that are held; in orbit the sideways ones turn about the subject.
  step(seconds) {
    const sum = [0, 0, 0], step = seconds / FLY_SECONDS;
    for (const key of this.held) KEYS[key].forEach((value, axis) => (sum[axis] += value));
    this.moved((pose) =>
      this.flies
        ? pose.moved(...sum.map((value) => value * step * pose.reach))
        : pose.turned(2 * sum[0] * step, 2 * sum[1] * step, this.up, true).nearer(Math.exp(-sum[2] * step)),
    );
  }
}

// Whether an element has a use of its own for a key: lists for letters, faders and choices for arrows.
const takes = (target, key) =>
  target instanceof HTMLElement && (target.matches("select, dialog *") || (target.matches("input") && key.length > 1));
const middle = (points, axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length;
const spread = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
