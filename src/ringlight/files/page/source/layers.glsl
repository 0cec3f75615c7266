// What the page may show of a surface, as files/layer_pictures.py shows it.
uniform int layer;
uniform vec3 background;
uniform vec2 nearFar;
const int COLOR = 0, BASE = 1, NORMAL = 2, DEPTH = 3;
const float FARTHEST_GRAY = 0.15, FAINTEST_SURFACE = 1e-4;

vec3 normalPicture(vec3 blendedNormal, float alpha) {
  return mix(background, clamp(0.5 + 0.5 * unit(blendedNormal), 0.0, 1.0), clamp(alpha, 0.0, 1.0));
}

vec3 depthPicture(float blendedDepth, float alpha) {
  float depth = alpha > FAINTEST_SURFACE ? blendedDepth / alpha : 0.0;
  float share = clamp((depth - nearFar.x) / max(nearFar.y - nearFar.x, 1e-12), 0.0, 1.0);
  return vec3((1.0 - share * (1.0 - FARTHEST_GRAY)) * clamp(alpha, 0.0, 1.0));
}
