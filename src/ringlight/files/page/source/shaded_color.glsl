// Gaussians that are shaded each by itself: colours come from the pass that made them, normals have two sides.
uniform usampler2D colors;
uniform sampler2D normals;
vec3 sum = vec3(0.0);

void add(int row, bool turned, float weight, float depth) {
  if (layer == NORMAL) sum += weight * numbered(normals, 2 * row + int(turned)).xyz;
  else if (layer == DEPTH) sum.x += weight * depth;
  else sum += weight * uintBitsToFloat(texelFetch(colors, placed(row), 0).rgb);
}
