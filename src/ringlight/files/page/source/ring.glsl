// Colours of ringlight-ring and ringlight-paper from where the camera is; the twin of fields/ring_tables.py and
// color/render_module.py. Texels a row: base colour, then latents by four.
uniform sampler2D means, surfaces, axes, view, core, shading;
uniform vec3 position, boxLow, boxSize, gain;
uniform float residual;
uniform usampler2D wanted;
layout(location = 0) out uvec4 color;

const int R4 = RANK / 4, LATENT_TEXELS = (LATENTS + 3) / 4;
// Rows of the product that are held at a time: with all of a rank of 16 registers would spill.
const int HELD = RANK > 8 ? 4 : RANK;

// Four numbers of a head's matrix between two nodes.
vec4 onAxis(int axis, int node, float part, int four) {
  int at = (axis * NODES + node) * RANK * R4 + four;
  return mix(numbered(axes, at), numbered(axes, at + RANK * R4), part);
}

vec4 onView(ivec2 node, vec2 part, int four) {
  int at = (node.y * VIEW_SIDE + node.x) * RANK * R4 + four, below = at + VIEW_SIDE * RANK * R4;
  vec4 upper = mix(numbered(view, at), numbered(view, at + RANK * R4), part.x);
  return mix(upper, mix(numbered(view, below), numbered(view, below + RANK * R4), part.x), part.y);
}

vec4 product[HELD * R4];

void multiplied(int axis, int node, float part, ivec2 viewNode, vec2 viewPart) {
  vec4 next[HELD * R4];
  for (int k = 0; k < HELD * R4; k++) next[k] = vec4(0.0);
  for (int k = 0; k < RANK; k++) {
    for (int j = 0; j < R4; j++) {
      vec4 four = axis < 3 ? onAxis(axis, node, part, k * R4 + j) : onView(viewNode, viewPart, k * R4 + j);
      for (int i = 0; i < HELD; i++) next[i * R4 + j] += product[i * R4 + k / 4][k % 4] * four;
    }
  }
  product = next;
}

void features(vec3 point, vec3 direction, out float a[FEATURES]) {
  int node[3];
  float part[3];
  for (int axis = 0; axis < 3; axis++) cell(point[axis], NODES, node[axis], part[axis]);
  ivec2 viewNode;
  vec2 viewPart, uv = octahedral(direction);
  cell(uv.x, VIEW_SIDE, viewNode.x, viewPart.x);
  cell(uv.y, VIEW_SIDE, viewNode.y, viewPart.y);
  for (int c = 0; c < FEATURES; c++) a[c] = 0.0;
  for (int first = 0; first < RANK; first += HELD) {
    for (int k = 0; k < HELD * R4; k++) product[k] = onAxis(0, node[0], part[0], first * R4 + k);
    multiplied(1, node[1], part[1], viewNode, viewPart);
    multiplied(2, node[2], part[2], viewNode, viewPart);
    multiplied(3, 0, 0.0, viewNode, viewPart);
    for (int c = 0; c < FEATURES; c++) {
      for (int k = 0; k < HELD * R4; k++) a[c] += dot(product[k], numbered(core, (c * RANK + first) * R4 + k));
    }
  }
  for (int c = 0; c < FEATURES; c++) a[c] = flatTanh(vec4(a[c])).x;
}

// Networks lie one after the other in `shading`: of each layer, by four outputs, weights by input, then the bias.
const int MODULATION_INPUTS = 3 + FEATURES, SEEN = MODULATION == 1 && !bool(FACTOR) ? 1 : 0;
const int RENDER_INPUTS = FEATURES + SEEN + 3 + LATENTS;

float modulation(vec3 direction, float a[FEATURES], inout int at) {
  float sum = 0.0;
  int last = at + (MODULATION_HIDDEN / 4) * (MODULATION_INPUTS + 1);
  for (int o = 0; o < MODULATION_HIDDEN / 4; o++) {
    vec4 unit4 = numbered(shading, at + MODULATION_INPUTS);
    for (int i = 0; i < MODULATION_INPUTS; i++) unit4 += numbered(shading, at + i) * (i < 3 ? direction[i] : a[i - 3]);
    unit4 = max(unit4, 0.0);
    for (int k = 0; k < 4; k++) sum += numbered(shading, last + 4 * o + k).x * unit4[k];
    at += MODULATION_INPUTS + 1;
  }
  sum += numbered(shading, last + MODULATION_HIDDEN).x;
  at = last + MODULATION_HIDDEN + 1;
  return 1.0 / (1.0 + exp(-sum));
}

vec3 render(float inputs[RENDER_INPUTS], int at) {
  vec4 hidden[HIDDEN / 4], second[HIDDEN / 4];
  for (int o = 0; o < HIDDEN / 4; o++) {
    vec4 sum = numbered(shading, at + RENDER_INPUTS);
    for (int i = 0; i < RENDER_INPUTS; i++) sum += numbered(shading, at + i) * inputs[i];
    hidden[o] = max(sum, 0.0);
    at += RENDER_INPUTS + 1;
  }
  for (int o = 0; o < HIDDEN / 4; o++) {
    vec4 sum = numbered(shading, at + HIDDEN);
    for (int i = 0; i < HIDDEN; i++) sum += numbered(shading, at + i) * hidden[i / 4][i % 4];
    second[o] = max(sum, 0.0);
    at += HIDDEN + 1;
  }
  vec4 sum = numbered(shading, at + HIDDEN);
  for (int i = 0; i < HIDDEN; i++) sum += numbered(shading, at + i) * second[i / 4][i % 4];
  return flatTanh(sum).xyz;
}

vec3 light(int row, vec3 base) {
  vec3 mean = numbered(means, row).xyz, direction = unit(mean - position);
  float a[FEATURES];
  features(clamp((mean - boxLow) * (2.0 / boxSize) - 1.0, -1.0, 1.0), direction, a);
  int at = 0;
  float inputs[RENDER_INPUTS], m = 1.0;
  for (int c = 0; c < FEATURES; c++) inputs[c] = a[c];
#if MODULATION
  m = modulation(direction, a, at);
#endif
  if (SEEN == 1) inputs[FEATURES] = m;
  for (int k = 0; k < 3; k++) inputs[FEATURES + SEEN + k] = base[k];
  int latents = row * (1 + LATENT_TEXELS) + 1;
  for (int k = 0; k < LATENTS; k++) inputs[FEATURES + SEEN + 3 + k] = numbered(surfaces, latents + k / 4)[k % 4];
  return (FACTOR == 1 ? m : 1.0) * render(inputs, at);
}

void main() {
  int row = int(gl_FragCoord.x) + 2048 * int(gl_FragCoord.y);
  if (texelFetch(wanted, ivec2(gl_FragCoord.xy), 0).r == 0u) discard;
  vec3 base = numbered(surfaces, row * (1 + LATENT_TEXELS)).xyz, shown = base;
  if (residual != 0.0) {
    shown += residual * gain * light(row, base);
    if (CLAMPED == 1) shown = clamp(shown, 0.0, 1.0);
  }
  color = uvec4(floatBitsToUint(shown), 0u);
}
