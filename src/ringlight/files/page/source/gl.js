// The few forms of WebGL2 that the page needs: programs that fill a target, and textures that hold numbers.
const WIDTH = 2048; // texels in a row of what is read by number; every WebGL2 has as many

export const texelRows = (count) => Math.max(Math.ceil(count / WIDTH), 1);

const FORMATS = {
  rgba32f: ["RGBA32F", "RGBA", "FLOAT", 4, Float32Array],
  rg32ui: ["RG32UI", "RG_INTEGER", "UNSIGNED_INT", 2, Uint32Array],
  r8ui: ["R8UI", "RED_INTEGER", "UNSIGNED_BYTE", 1, Uint8Array],
  r32ui: ["R32UI", "RED_INTEGER", "UNSIGNED_INT", 1, Uint32Array],
  rgba32ui: ["RGBA32UI", "RGBA_INTEGER", "UNSIGNED_INT", 4, Uint32Array],
  rgba8ui: ["RGBA8UI", "RGBA_INTEGER", "UNSIGNED_BYTE", 4, Uint8Array],
};

// A texture of whole rows; `write` replaces the first `count` texels by those at the head of `values`, which must reach
// to the end of the row.
export class Texture {
  constructor(gl, format, width, height, values = null) {
    [this.format, this.gl, this.width, this.height] = [FORMATS[format], gl, width, height];
    const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    if (width > most || height > most) throw new Error("the model is too large for this graphics card");
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl[this.format[0]], width, height);
    if (values) this.write(values, width * height);
  }

  write(values, count) {
    this.writeRows(values, 0, Math.ceil(count / this.width));
  }

  // Replace `rows` rows from the `first` on by the same rows of `values`, which begin with row 0.
  writeRows(values, first, rows) {
    const gl = this.gl,
      [, layout, type, channels] = this.format,
      from = first * this.width * channels;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    if (rows) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, first, this.width, rows, gl[layout], gl[type], values, from);
  }

  free() {
    this.gl.deleteTexture(this.texture);
  }
}

// A texture that is read by number: `values` of `count` texels, padded to whole rows.
export function numbered(gl, format, count, values = null) {
  const [, , , channels, Kind] = FORMATS[format],
    height = texelRows(count);
  if (!values) return new Texture(gl, format, WIDTH, height);
  const padded = new Kind(WIDTH * height * channels);
  padded.set(values.subarray(0, padded.length));
  return new Texture(gl, format, WIDTH, height, padded);
}

export function paddedLength(count, channels) {
  return WIDTH * texelRows(count) * channels;
}

// Rows of `width` numbers as texels of four, each row padded with zeros: [rows, ceil(width / 4) texels].
export function inTexels(values, width) {
  const rows = width ? values.length / width : 0,
    texels = Math.ceil(width / 4);
  if (width === 4 * texels) return values;
  const padded = new values.constructor(4 * texels * rows);
  for (let row = 0; row < rows; row++) padded.set(values.subarray(width * row, width * (row + 1)), 4 * texels * row);
  return padded;
}

const CORNERS = `void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

// A program that runs once for each pixel of its target. `sizes` become constants of the source.
export class Program {
  constructor(gl, sources, sizes = {}) {
    const constants = Object.entries(sizes).map(([name, value]) => `#define ${name} ${value}`);
    const head = [
      "#version 300 es",
      "precision highp float;",
      "precision highp int;",
      "precision highp sampler2D;",
      "precision highp usampler2D;",
    ];
    this.gl = gl;
    this.program = gl.createProgram();
    this.attach(gl.VERTEX_SHADER, `#version 300 es\n${CORNERS}`);
    this.attach(gl.FRAGMENT_SHADER, [...head, ...constants, ...sources].join("\n"));
    gl.linkProgram(this.program);
    this.places = new Map();
  }

  attach(kind, source) {
    const gl = this.gl,
      shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(this.program, shader);
    this.shaders = [...(this.shaders ?? []), shader];
  }

  // Raises where the browser's compiler refused; asked last, since it may compile meanwhile.
  use() {
    const gl = this.gl;
    if (!this.checked && !gl.getProgramParameter(this.program, gl.LINK_STATUS)) {
      const said = this.shaders.map((shader) => gl.getShaderInfoLog(shader)).join(" ");
      throw new Error(`a shader was refused: ${said} ${gl.getProgramInfoLog(this.program)}`);
    }
    this.checked = true;
    gl.useProgram(this.program);
    return this;
  }

  place(name) {
    if (!this.places.has(name)) this.places.set(name, this.gl.getUniformLocation(this.program, name));
    return this.places.get(name);
  }

  // Floats by name, as many components as are given; nine are a matrix, columns first.
  numbers(values) {
    for (const [name, value] of Object.entries(values)) {
      const list = Array.isArray(value) || ArrayBuffer.isView(value) ? value : [value];
      if (list.length === 9) this.gl.uniformMatrix3fv(this.place(name), false, list);
      else this.gl[`uniform${list.length}fv`](this.place(name), list);
    }
    return this;
  }

  wholes(values) {
    for (const [name, value] of Object.entries(values)) {
      const list = Array.isArray(value) ? value : [value];
      if (list.length === 2 && !name.startsWith("map_")) this.gl.uniform2iv(this.place(name), list);
      else this.gl.uniform1iv(this.place(name), list);
    }
    return this;
  }

  textures(values) {
    Object.entries(values).forEach(([name, texture], unit) => {
      this.gl.activeTexture(this.gl.TEXTURE0 + unit);
      this.gl.bindTexture(this.gl.TEXTURE_2D, texture.texture);
      this.gl.uniform1i(this.place(name), unit);
    });
    return this;
  }

  block(name, buffer) {
    const gl = this.gl,
      index = gl.getUniformBlockIndex(this.program, name);
    gl.uniformBlockBinding(this.program, index, 0);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, buffer);
    return this;
  }

  draw(target, width, height) {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.viewport(0, 0, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

// A program of these of the page's `shaders`, one after the other.
export function programOf(gl, shaders, names, sizes) {
  const sources = names.map((name) => shaders[name]);
  return new Program(gl, sources, sizes);
}
