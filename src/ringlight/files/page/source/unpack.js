// Numbers as `ringlight compress` packs them, back to floats; the twin of files/pack_numbers.py and pack_directions.py.
const OCTAHEDRAL_STEPS = 1022,
  QUATERNION_STEPS = 1022,
  TURN_STEPS = 254,
  DARKEST = 0.25 / 255;

const OTHERS = [
  [1, 2, 3],
  [0, 2, 3],
  [0, 1, 3],
  [0, 1, 2],
];

const UNPACKINGS = {
  half: (parts) => ({ shape: parts.half.shape, values: Float32Array.from(parts.half.values, floatFromHalf) }),
  rows8: unpackRows,
  fixed8: unpackFixed,
  fixed10: (parts) => unpackFine(parts, 2),
  fixed12: (parts) => unpackFine(parts, 4),
  fixed16: unpackFixed,
  fixed24: unpackFixed,
  share8: unpackShare,
  directions20: unpackDirections,
  quaternions32: unpackQuaternions,
  turns24: unpackTurns,
};

// All tensors by name, { shape, values }; what was not packed is as it was.
export function unpackTensors({ parts, packing }) {
  const tensors = new Map();
  for (const [name, found] of parts) {
    const kind = packing[name];
    tensors.set(name, kind ? UNPACKINGS[kind](found) : found[""]);
  }
  return tensors;
}

export function floatFromHalf(half) {
  const exponent = (half >> 10) & 31,
    fraction = half & 1023,
    sign = half & 0x8000 ? -1 : 1;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * (fraction / 1024));
}

function unpackRows({ codes, scale }) {
  const each = codes.values.length / (scale.values.length || 1);
  const values = Float32Array.from(codes.values, (code, index) => code * scale.values[Math.floor(index / each)]);
  return { shape: codes.shape, values };
}

function unpackFixed({ codes, low, step }) {
  const width = codes.shape.at(-1),
    columns = low.values.length,
    count = codes.values.length / width;
  const values = new Float32Array(count);
  for (let index = 0; index < count; index++) {
    let whole = 0;
    for (let place = width - 1; place >= 0; place--) whole = whole * 256 + codes.values[index * width + place];
    const column = index % columns;
    values[index] = low.values[column] + step.values[column] * whole;
  }
  return { shape: codes.shape.slice(0, -1), values };
}

// A byte and so many bits below it, which follow each other in the bytes of `fine`.
function unpackFine({ codes, fine, low, step }, bits) {
  const columns = low.values.length,
    mask = (1 << bits) - 1;
  const values = Float32Array.from(codes.values, (code, index) => {
    const column = index % columns,
      below = (fine.values[(index * bits) >> 3] >> ((index * bits) & 7)) & mask;
    return low.values[column] + step.values[column] * ((code << bits) | below);
  });
  return { shape: codes.shape, values };
}

function unpackShare({ share }) {
  const logits = Float32Array.from({ length: 256 }, (_, code) => {
    const value = Math.min(Math.max(code / 255, DARKEST), 1 - DARKEST);
    return Math.log(value / (1 - value));
  });
  return { shape: share.shape, values: Float32Array.from(share.values, (code) => logits[code]) };
}

function unpackDirections({ low, high }) {
  const rows = low.shape[0],
    values = new Float32Array(rows * 3);
  for (let row = 0; row < rows; row++) {
    const nibble = (high.values[row >> 1] >> (4 * (row & 1))) & 15;
    const u = (low.values[2 * row] | ((nibble & 3) << 8)) * (2 / OCTAHEDRAL_STEPS) - 1;
    const v = (low.values[2 * row + 1] | ((nibble >> 2) << 8)) * (2 / OCTAHEDRAL_STEPS) - 1;
    const z = 1 - Math.abs(u) - Math.abs(v),
      fold = Math.max(-z, 0);
    const x = u + (u >= 0 ? -fold : fold),
      y = v + (v >= 0 ? -fold : fold),
      length = Math.hypot(x, y, z);
    values.set([x / length, y / length, z / length], 3 * row);
  }
  return { shape: [rows, 3], values };
}

function unpackQuaternions({ words }) {
  const rows = words.shape[0],
    values = new Float32Array(rows * 4);
  for (let row = 0; row < rows; row++) {
    const [a, b, c, d] = words.values.subarray(4 * row, 4 * row + 4);
    const word = (a | (b << 8) | (c << 16) | (d << 24)) >>> 0,
      largest = word >>> 30,
      others = OTHERS[largest];
    let left = 1;
    others.forEach((component, place) => {
      const code = (word >>> (20 - 10 * place)) & 1023;
      const value = (code * (2 / QUATERNION_STEPS) - 1) * Math.SQRT1_2;
      values[4 * row + component] = value;
      left -= value * value;
    });
    values[4 * row + largest] = Math.sqrt(Math.max(left, 0));
  }
  return { shape: [rows, 4], values };
}

function unpackTurns({ codes }) {
  const rows = codes.shape[0],
    values = new Float32Array(rows * 4);
  for (let row = 0; row < rows; row++) {
    let left = 1;
    for (let k = 0; k < 3; k++) {
      const value = (codes.values[3 * row + k] * (2 / TURN_STEPS) - 1) * Math.SQRT1_2;
      values[4 * row + 1 + k] = value;
      left -= value * value;
    }
    values[4 * row] = Math.sqrt(Math.max(left, 0));
  }
  return { shape: [rows, 4], values };
}
