// Colours of 3igs from where the camera is; the twin of color/illuminated.py, as it is condensed for a page. Texels a
// row: base colour and roughness, then components by four.
uniform sampler2D means, surfaces, network;
uniform vec3 position;
uniform float residual;
uniform usampler2D wanted;
layout(location = 0) out uvec4 color;

const int CODE_TEXELS = (CODES + 1) / 2, INPUTS = COMPONENT_TEXELS + 1 + CODE_TEXELS, H4 = HIDDEN / 4;
const int HIGHEST = 8;

// Of each level 1, 2, 4, 8 and each order real and imaginary part; factors that make harmonics of derivatives of
// Legendre's polynomials are in the weights. The derivatives come by their recurrence in the level.
void encode(vec3 v, float roughness, out vec2 code[2 * CODE_TEXELS]) {
  vec4 fading = exp(-roughness * vec4(1.0, 3.0, 10.0, 36.0)); // level (level + 1) / 2
  vec2 around = vec2(1.0, 0.0);
  float diagonal = 1.0;
  code[2 * CODE_TEXELS - 1] = vec2(0.0);
  for (int order = 0; order <= HIGHEST; order++) {
    float before = 0.0, now = diagonal;
    for (int level = order; level <= HIGHEST; level++) {
      vec2 part = now * around;
      if (level == 1) code[order] = part * fading.x;
      else if (level == 2) code[2 + order] = part * fading.y;
      else if (level == 4) code[5 + order] = part * fading.z;
      else if (level == 8) code[10 + order] = part * fading.w;
      float next = (float(2 * level + 1) * v.z * now - float(level + order) * before) / float(level - order + 1);
      before = now;
      now = next;
    }
    around = vec2(v.x * around.x - v.y * around.y, v.x * around.y + v.y * around.x);
    diagonal *= float(2 * order + 1);
  }
}

// Four outputs' share of four inputs, whose weights begin at `at`.
vec4 weighed(int at, vec4 four) {
  return numbered(network, at) * four.x + numbered(network, at + 1) * four.y + numbered(network, at + 2) * four.z +
         numbered(network, at + 3) * four.w;
}

vec3 light(int row, float roughness) {
  vec3 direction = unit(numbered(means, row).xyz - position);
  vec2 code[2 * CODE_TEXELS];
  encode(direction, roughness, code);
  vec4 inputs[INPUTS], hidden[H4], result = vec4(0.0);
  int own = row * (1 + COMPONENT_TEXELS) + 1, at = 0;
  for (int j = 0; j < COMPONENT_TEXELS; j++) inputs[j] = numbered(surfaces, own + j);
  inputs[COMPONENT_TEXELS] = vec4(direction, 0.0);
  for (int j = 0; j < CODE_TEXELS; j++) inputs[COMPONENT_TEXELS + 1 + j] = vec4(code[2 * j], code[2 * j + 1]);
  for (int o = 0; o < H4; o++) {
    vec4 sum = numbered(network, at + 4 * INPUTS);
    for (int j = 0; j < INPUTS; j++) sum += weighed(at + 4 * j, inputs[j]);
    hidden[o] = max(sum, 0.0);
    at += 4 * INPUTS + 1;
  }
  // Units of the second layer go into the results at once and need no room.
  int last = at + H4 * (HIDDEN + 1);
  for (int o = 0; o < H4; o++) {
    vec4 sum = numbered(network, at + HIDDEN);
    for (int j = 0; j < H4; j++) sum += weighed(at + 4 * j, hidden[j]);
    result += weighed(last + 4 * o, max(sum, 0.0));
    at += HIDDEN + 1;
  }
  return flatTanh(result + numbered(network, last + HIDDEN)).xyz;
}

void main() {
  int row = int(gl_FragCoord.x) + 2048 * int(gl_FragCoord.y);
  if (texelFetch(wanted, ivec2(gl_FragCoord.xy), 0).r == 0u) discard;
  vec4 surface = numbered(surfaces, row * (1 + COMPONENT_TEXELS));
  vec3 shown = surface.rgb;
  if (residual != 0.0) shown = clamp(shown + residual * light(row, surface.a), 0.0, 1.0);
  color = uvec4(floatBitsToUint(shown), 0u);
}
