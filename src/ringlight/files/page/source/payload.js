// The model in the page: text to bytes, inflated, and cut into named parts.
import { bytesFromText } from "./text_bytes.js";

const ARRAYS = {
  u8: Uint8Array,
  i8: Int8Array,
  u16: Uint16Array,
  f32: Float32Array,
  f64: Float64Array,
  i64: BigInt64Array,
};

export async function readPayload(element) {
  const packed = bytesFromText(element.textContent, Number(element.dataset.bytes));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  const headed = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, headed)));
  const parts = new Map();
  for (const stored of header.parts) {
    const values = new ARRAYS[stored.type](buffer, header.start + stored.at, stored.count);
    const part = { values: ordered(stored, values), shape: stored.shape, type: stored.type };
    if (!parts.has(stored.tensor)) parts.set(stored.tensor, {});
    parts.get(stored.tensor)[stored.part] = part;
  }
  return { parts, packing: header.packing, texts: header.texts };
}

// Columns are stored one after the other, since neighbours in a column are alike; here rows stand together again.
function ordered(stored, values) {
  if (stored.order === "rows") return values;
  const rows = stored.shape[0],
    width = rows ? stored.count / rows : 0;
  const found = new values.constructor(stored.count);
  for (let column = 0; column < width; column++) {
    for (let row = 0; row < rows; row++) found[row * width + column] = values[column * rows + row];
  }
  return stored.order === "steps" ? summed(found, stored.shape) : found;
}

// Whole numbers of several bytes, stored as differences from row to row: even codes go up, odd ones down.
function summed(bytes, shape) {
  const [rows, columns, width] = shape,
    range = 2 ** (8 * width);
  const last = new Float64Array(columns);
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const at = (row * columns + column) * width;
      let code = 0;
      for (let place = width - 1; place >= 0; place--) code = code * 256 + bytes[at + place];
      const step = code % 2 ? -(code + 1) / 2 : code / 2;
      let whole = (last[column] = (last[column] + step + range) % range);
      for (let place = 0; place < width; place++) {
        bytes[at + place] = whole % 256;
        whole = Math.floor(whole / 256);
      }
    }
  }
  return bytes;
}
