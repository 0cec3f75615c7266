// For each tile of the picture the ellipses that reach it, nearest first.
//
// A shader that walks down such a list keeps its sums in registers and stops when the light is used up: no blended
// targets, so nothing of a fragment goes through memory, and 32-bit sums cost no more than 16-bit ones.
import { ELLIPSE } from "./projection.js";

const FIRST_TILE = 8,
  LARGEST_TILE = 256,
  MIN_ALPHA = 1 / 255;
const ENTRIES_IN_A_ROW = 2048; // of the texture that takes them

export class TileLists {
  constructor() {
    this.first = new Int32Array(1);
    this.last = new Int32Array(1);
    this.top = this.bottom = 0;
  }

  // Ellipses are in drawing order. `most` entries are all that fit: larger tiles are taken where there are more.
  // Gives the tile's side in pixels, and fills `tiles` with first entry and count of each tile; `entries` are returned,
  // a larger array where those handed over are too few.
  fill(ellipses, count, size, most, tiles, entries) {
    for (let side = FIRST_TILE; ; side *= 2) {
      const across = Math.ceil(size[0] / side),
        down = Math.ceil(size[1] / side);
      if (2 * across * down > tiles.length) continue;
      let total = this.counted(ellipses, count, side, across, down, tiles, Infinity);
      if (total > most && side < LARGEST_TILE) continue;
      // What does not fit even then is what lies behind: all tiles keep equally many at most.
      const each = total > most ? Math.floor(most / (across * down)) : Infinity;
      if (total > most) total = this.counted(ellipses, count, side, across, down, tiles, each);
      if (entries.length < total) entries = new Uint32Array(roomFor(total, most));
      this.written(ellipses, count, side, across, down, tiles, entries, each);
      return { side, across, down, total, entries };
    }
  }

  counted(ellipses, count, side, across, down, tiles, each) {
    const counts = tiles.fill(0, 0, 2 * across * down);
    for (let index = 0; index < count; index++) {
      this.span(ellipses, index, side, across, down);
      for (let row = this.top; row <= this.bottom; row++) {
        for (let column = this.first[row]; column <= this.last[row]; column++)
          counts[2 * (row * across + column) + 1]++;
      }
    }
    let sum = 0;
    for (let tile = 0; tile < across * down; tile++) {
      tiles[2 * tile] = sum;
      sum += Math.min(tiles[2 * tile + 1], each);
      tiles[2 * tile + 1] = 0;
    }
    return sum;
  }

  written(ellipses, count, side, across, down, tiles, entries, each) {
    for (let index = 0; index < count; index++) {
      this.span(ellipses, index, side, across, down);
      for (let row = this.top; row <= this.bottom; row++) {
        for (let column = this.first[row]; column <= this.last[row]; column++) {
          const tile = 2 * (row * across + column);
          if (tiles[tile + 1] < each) entries[tiles[tile] + tiles[tile + 1]++] = index;
        }
      }
    }
  }

  // `top` and `bottom` row of tiles that an ellipse reaches, and of each its first and last column, exactly: where
  // 1/2 d^T conic d <= ln(opacity / MIN_ALPHA) at a pixel's centre is possible.
  span(ellipses, index, side, across, down) {
    if (this.first.length < down) {
      this.first = new Int32Array(down);
      this.last = new Int32Array(down);
    }
    const at = ELLIPSE * index,
      x = ellipses[at],
      y = ellipses[at + 1];
    const reach = 2 * Math.log(ellipses[at + 2] / MIN_ALPHA) * 1.0001;
    const xx = ellipses[at + 4],
      xy = ellipses[at + 5],
      yy = ellipses[at + 6],
      determinant = xx * yy - xy * xy;
    const wide = Math.sqrt((reach * yy) / determinant),
      high = Math.sqrt((reach * xx) / determinant);
    this.top = Math.max(Math.floor((y - high - 0.5) / side), 0);
    this.bottom = Math.min(Math.floor((y + high) / side), down - 1);
    const right = (-xy * wide) / yy;
    for (let row = this.top; row <= this.bottom; row++) {
      const low = Math.max(row * side + 0.5 - y, -high),
        most = Math.min((row + 1) * side - 0.5 - y, high);
      const atRight = Math.min(Math.max(right, low), most),
        atLeft = Math.min(Math.max(-right, low), most);
      const end = x + offset(atRight, 1, xx, xy, yy, reach),
        begin = x + offset(atLeft, -1, xx, xy, yy, reach);
      this.first[row] = Math.max(Math.floor((begin - 0.5) / side), 0);
      this.last[row] = Math.min(Math.floor((end - 0.5) / side + 1e-6), across - 1);
    }
  }
}

// Half as many again, so that lists seldom grow.
function roomFor(wanted, most) {
  return Math.min(Math.ceil((1.5 * wanted) / ENTRIES_IN_A_ROW) * ENTRIES_IN_A_ROW, most);
}

// Where the ellipse's border lies at a height, to the right or to the left of the centre.
function offset(height, sign, xx, xy, yy, reach) {
  const root = Math.max(xy * xy * height * height - xx * (yy * height * height - reach), 0);
  return (-xy * height + sign * Math.sqrt(root)) / xx;
}
