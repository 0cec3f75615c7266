// Gaussians of 3dgs-dr: base colour, normal and strength of the reflection are blended.
uniform usampler2D colors;
uniform sampler2D surfaces; // normal, strength
vec3 base = vec3(0.0), normal = vec3(0.0);
float strength = 0.0, depthSum = 0.0;

void add(int row, bool turned, float weight, float depth) {
  vec4 surface = numbered(surfaces, row);
  base += weight * uintBitsToFloat(texelFetch(colors, placed(row), 0).rgb);
  normal += (turned ? -weight : weight) * surface.xyz;
  strength += weight * surface.w;
  depthSum += weight * depth;
}
