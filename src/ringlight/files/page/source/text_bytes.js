// Bytes as text that HTML leaves as it is, seven bits a character; the twin of files/page/text_bytes.py. Three
// characters would not survive a parser (NUL, carriage return, "<"). In place of such a group stands one character from
// PAIRS on, which holds which of the three it was and the seven bits of the next group.
const REFUSED = [0, 13, 60];
const PAIRS = 256;

export function bytesFromText(text, length) {
  const bytes = new Uint8Array(length);
  let held = 0,
    bits = 0,
    at = 0;
  const take = (group) => {
    held = (held << 7) | group;
    bits += 7;
    if (bits >= 8 && at < length) {
      bits -= 8;
      bytes[at++] = (held >> bits) & 255;
      held &= (1 << bits) - 1;
    }
  };
  for (let index = 0; index < text.length; index++) {
    const code = text.charCodeAt(index);
    if (code < 128) {
      take(code);
    } else {
      take(REFUSED[(code - PAIRS) >> 7]);
      take((code - PAIRS) & 127);
    }
  }
  return bytes;
}
