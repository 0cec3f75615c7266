// Colours of all Gaussians from where the camera is, in a texture: made again only when its position or the fader
// changes.
import { Texture, texelRows } from "./gl.js";

const HEIGHT_AT_ONCE = 8; // rows of 2048 Gaussians that a moving camera recolours in one picture

export class Colors {
  // `recolor` is the program that makes them of these textures, numbers and whole numbers.
  constructor(gl, recolor, rows, { textures, numbers = {}, wholes = {} }) {
    Object.assign(this, { gl, recolor, rows, textures, numbers, wholes });
    this.colors = new Texture(gl, "rgba32ui", 2048, texelRows(rows));
    this.target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.colors.texture, 0);
    // Camera position and fader of the colours, how many rows of 2048 are still of earlier ones, and the next of them.
    this.made = null;
  }

  // Bring the colours up to date; with `some` only a part of them, if there are many. True once all are.
  prepare({ position }, residual, some) {
    const wish = [...position, residual].join(),
      height = this.colors.height;
    if (this.made?.wish !== wish) this.made = { wish, left: height, next: this.made?.next ?? 0 };
    if (!this.made.left) return true;
    const gl = this.gl,
      lines = some ? Math.min(HEIGHT_AT_ONCE, this.made.left) : this.made.left;
    const first = this.made.next;
    this.recolor
      .use()
      .textures(this.textures)
      .numbers({ ...this.numbers, position, residual });
    this.recolor.wholes({ ...this.wholes, rows: this.rows });
    gl.enable(gl.SCISSOR_TEST);
    for (let line = 0; line < lines;) {
      const from = (first + line) % height,
        here = Math.min(lines - line, height - from);
      gl.scissor(0, from, 2048, here);
      this.recolor.draw(this.target, 2048, height);
      line += here;
    }
    gl.disable(gl.SCISSOR_TEST);
    this.made.next = (first + lines) % height;
    this.made.left -= lines;
    return this.made.left === 0;
  }
}
