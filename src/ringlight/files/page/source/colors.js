// Colours of the Gaussians that can be seen from where the camera is, in a texture: each made again only when the
// camera's position or the fader has changed since.
import { Texture, texelRows } from "./gl.js";

const AT_ONCE = 8 * 2048; // Gaussians that a moving camera recolours in one picture, where a kind does not say
const NEVER = 0,
  EARLIER = 1,
  NOW = 2; // when a Gaussian's colour was made

export class Colors {
  // `recolor` is the program that makes them of these textures, numbers and whole numbers.
  constructor(gl, recolor, rows, { textures, numbers = {}, wholes = {}, atOnce = AT_ONCE }) {
    Object.assign(this, { gl, recolor, textures, numbers, wholes, atOnce });
    const height = texelRows(rows);
    this.colors = new Texture(gl, "rgba32ui", 2048, height);
    this.wanted = new Texture(gl, "r8ui", 2048, height); // one where a colour is to be made
    this.target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.colors.texture, 0);
    this.made = new Uint8Array(2048 * height).fill(NEVER);
    this.marks = new Uint8Array(2048 * height);
    this.wish = null; // camera position and fader that NOW stands for
  }

  // The next picture makes all colours anew.
  forget() {
    this.wish = null;
  }

  // Bring the colours of what is `seen` up to date, nearest first; with `some` only a part of those that have one. True
  // once all are.
  prepare({ camera, seen }, residual, some) {
    const wish = [...camera.position, residual].join();
    if (this.wish !== wish) {
      this.wish = wish;
      for (let row = 0; row < this.made.length; row++) if (this.made[row] === NOW) this.made[row] = EARLIER;
    }
    const { left, first, last } = this.mark(seen, some ? this.atOnce : Infinity);
    if (first > last) return true;
    const gl = this.gl,
      lines = last - first + 1;
    this.wanted.writeRows(this.marks, first, lines);
    const textures = { ...this.textures, wanted: this.wanted };
    const numbers = { ...this.numbers, position: camera.position, residual };
    this.recolor.use().textures(textures).numbers(numbers).wholes(this.wholes);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, first, 2048, lines);
    this.recolor.draw(this.target, 2048, this.colors.height);
    gl.disable(gl.SCISSOR_TEST);
    this.marks.fill(0, 2048 * first, 2048 * (last + 1));
    return left === 0;
  }

  // Mark what is to be made: all that never was, and `most` of the others. How many of these are left, and the first
  // and last line of the texture with a mark.
  mark({ rows, count }, most) {
    const { made, marks } = this;
    let left = 0,
      first = Infinity,
      last = -1;
    for (let place = 0; place < count; place++) {
      const row = rows[place];
      if (made[row] === NOW) continue;
      if (made[row] === EARLIER && most-- <= 0) {
        left++;
        continue;
      }
      made[row] = NOW;
      marks[row] = 1;
      const line = row >> 11;
      if (line < first) first = line;
      if (line > last) last = line;
    }
    return { left, first, last };
  }
}
