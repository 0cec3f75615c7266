// What a pixel reflects; the twin of shade/reflection.py, fields/octahedral.py and parallax.py.
uniform sampler2D maps, places;
uniform vec3 position, boxMiddle;
uniform float boxHalf, residual, light;
uniform vec4 sphere;
uniform int map_sides[LEVELS], map_rows[LEVELS];
layout(std140) uniform Network { vec4 weights[WEIGHTS]; };
out vec4 shown;

const float SMALLEST_HALF_CHORD_SQUARED = 1e-6;
const int FEATURES = 4 * LEVELS, INPUTS = 1 + LATENTS + 3 + FEATURES + 3 * RAW_DIRECTION;

vec4 onMap(int level, vec2 uv) {
  int column, row, side = map_sides[level];
  float across, down;
  cell(uv.x, side, column, across);
  cell(uv.y, side, row, down);
  ivec2 corner = ivec2(column, row + map_rows[level]);
  vec4 upper = mix(texelFetch(maps, corner, 0), texelFetch(maps, corner + ivec2(1, 0), 0), across);
  vec4 lower = mix(texelFetch(maps, corner + ivec2(0, 1), 0), texelFetch(maps, corner + ivec2(1, 1), 0), across);
  return mix(upper, lower, down);
}

#if AXIS_NODES > 0
// Factors of a point: rows of the texture are the nodes of x, then y, then z; a texel holds those of one level.
vec4 onAxes(int level, vec3 point) {
  vec4 factor = vec4(1.0);
  for (int axis = 0; axis < 3; axis++) {
    int node;
    float part;
    cell(point[axis], AXIS_NODES, node, part);
    int row = axis * AXIS_NODES + node;
    factor *= mix(texelFetch(places, ivec2(level, row), 0), texelFetch(places, ivec2(level, row + 1), 0), part);
  }
  return factor;
}
#endif

vec3 exitOfSphere(vec3 point, vec3 direction) {
  vec3 local = (point - sphere.xyz) * exp(sphere.w);
  float along = dot(local, direction);
  float chord = along * along - dot(local, local) + 1.0;
  return local + (sqrt(max(chord, SMALLEST_HALF_CHORD_SQUARED)) - along) * direction;
}

vec4 fourInputs(int at, vec4 four) {
  return mat4(weights[at], weights[at + 1], weights[at + 2], weights[at + 3]) * four;
}

// Layers of the network: weights by four outputs and one input, then the bias by four; ReLU in between.
vec3 network(float inputs[INPUTS]) {
  vec4 hidden[HIDDEN / 4];
  int at = 0;
  for (int o = 0; o < HIDDEN / 4; o++) {
    vec4 sum = weights[at + INPUTS];
    for (int i = 0; i < INPUTS; i++) sum += weights[at + i] * inputs[i];
    hidden[o] = max(sum, 0.0);
    at += INPUTS + 1;
  }
#if LAYERS == 2
  vec4 second[HIDDEN / 4];
  for (int o = 0; o < HIDDEN / 4; o++) {
    vec4 sum = weights[at + HIDDEN];
    for (int i = 0; i < HIDDEN / 4; i++) {
      sum += fourInputs(at, hidden[i]);
      at += 4;
    }
    second[o] = max(sum, 0.0);
    at += 1;
  }
  hidden = second;
#endif
  vec4 sum = weights[at + HIDDEN];
  for (int i = 0; i < HIDDEN / 4; i++) {
    sum += fourInputs(at, hidden[i]);
    at += 4;
  }
  return sum.xyz;
}

vec3 reflectedLight(float alpha) {
  vec3 n = surfaceNormal(), ray = pixelRay(), direction = ray * inversesqrt(dot(ray, ray));
  vec3 point = (position + ray * (depthSum / alpha) - boxMiddle) / boxHalf;
  vec3 reflected = mirrored(direction, n);
#if PARALLAX
  reflected = exitOfSphere(point, reflected);
#endif
  vec2 uv = octahedral(reflected);
  float inputs[INPUTS];
  int at = 0;
  inputs[at++] = -dot(direction, n);
  for (int k = 0; k < LATENTS; k++) inputs[at++] = latents[k / 4][k % 4] / alpha;
  for (int k = 0; k < 3; k++) inputs[at++] = base[k] / alpha;
  for (int level = 0; level < LEVELS; level++) {
    vec4 features = onMap(level, uv);
#if AXIS_NODES > 0
    features *= onAxes(level, point);
#endif
    for (int k = 0; k < 4; k++) inputs[at++] = features[k];
  }
#if RAW_DIRECTION
  for (int k = 0; k < 3; k++) inputs[at++] = direction[k];
#endif
  return network(inputs);
}

void main() {
  for (int k = 0; k <= LATENT_TEXELS; k++) latents[k] = vec4(0.0);
  float left = blended(), alpha = 1.0 - left;
  vec3 color = base + left * background;
  if (layer == NORMAL) color = normalPicture(normal, alpha);
  else if (layer == DEPTH) color = depthPicture(depthSum, alpha);
  else {
    if (alpha > FAINTEST_SHADED && light != 0.0) color += light * alpha * reflectedLight(alpha);
#if BASIS > 0
    color += (1.0 - residual) * (constant - base);
#endif
  }
  shown = vec4(color, 1.0);
}
