// Nearest first, equal depths in the order of the table: two passes of a radix sort over the bits of positive floats.
const DIGITS = 1 << 16;

export class DepthOrder {
  constructor(most) {
    this.order = new Uint32Array(most);
    this.between = new Uint32Array(most);
    this.counts = new Uint32Array(DIGITS);
  }

  // `order` of the first `count` depths.
  sort(depths, count) {
    const keys = new Uint32Array(depths.buffer, depths.byteOffset, count);
    this.pass(keys, count, 0, null, this.between);
    this.pass(keys, count, 16, this.between, this.order);
    return this.order;
  }

  pass(keys, count, shift, from, to) {
    const counts = this.counts.fill(0);
    for (let index = 0; index < count; index++) counts[(keys[index] >>> shift) & 0xffff]++;
    for (let digit = 0, sum = 0; digit < DIGITS; digit++) {
      const here = counts[digit];
      counts[digit] = sum;
      sum += here;
    }
    for (let index = 0; index < count; index++) {
      const row = from ? from[index] : index;
      to[counts[(keys[row] >>> shift) & 0xffff]++] = row;
    }
  }
}
