// Colours of gaussian-shader: harmonics, and `residual` times what each surface reflects of the blurred environment;
// the twin of color/shaded_gaussians.py, color/split_sum.py and looked_up() in color/specular_table.py.
// Texels a row of `normals`: where the shortest axis looks towards the camera as it is stored, and turned round. Of
// `surfaces`: that axis and roughness, then tint. Of `levels`, for each map: side, first texel, roughness.
uniform sampler2D normals, surfaces, levels, maps, shares;

vec3 onLevel(int level, int face, vec2 at) {
  vec4 found = numbered(levels, level);
  at = at * found.x + 0.5;
  vec2 corner = clamp(floor(at), 0.0, found.x), part = at - corner;
  int wide = int(found.x) + 2, first = int(found.y) + (face * wide + int(corner.y)) * wide + int(corner.x);
  vec4 upper = mix(numbered(maps, first), numbered(maps, first + 1), part.x);
  return mix(upper, mix(numbered(maps, first + wide), numbered(maps, first + wide + 1), part.x), part.y).rgb;
}

// What a mirror of this roughness shows in a direction, between two maps. That of diffuse light is the last of all.
vec3 specular(vec3 v, float roughness) {
  vec2 at;
  int face = faceOf(v, at), upper = 1;
  while (upper < LEVELS - 2 && roughness > numbered(levels, upper).z) upper++;
  float finer = numbered(levels, upper - 1).z, coarser = numbered(levels, upper).z;
  float share = clamp((roughness - finer) / (coarser - finer), 0.0, 1.0);
  return mix(onLevel(upper - 1, face, at), onLevel(upper, face, at), share);
}

// How much of an even sky is reflected: times the tint, and besides.
vec2 reflectedShares(float cosine, float roughness) {
  vec2 at = vec2(cosine, roughness) * float(TABLE_NODES - 1);
  ivec2 node = min(ivec2(at), TABLE_NODES - 2);
  vec2 part = at - vec2(node);
  int first = node.y * TABLE_NODES + node.x, above = first + TABLE_NODES;
  vec4 smoother = mix(numbered(shares, first), numbered(shares, first + 1), part.x);
  return mix(smoother, mix(numbered(shares, above), numbered(shares, above + 1), part.x), part.y).xy;
}

vec3 reflected(int row, vec3 view) {
  vec4 surface = numbered(surfaces, 2 * row);
  vec3 tint = numbered(surfaces, 2 * row + 1).rgb;
  bool turned = dot(view, surface.xyz) > 0.0;
  vec3 normal = numbered(normals, 2 * row + int(turned)).xyz;
  float along = dot(view, normal);
  vec2 share = reflectedShares(clamp(-along, 0.0, 1.0), surface.w);
  vec3 light = specular(view - 2.0 * along * normal, surface.w) * (tint * share.x + share.y);
#if AMBIENT
  vec2 at;
  int face = faceOf(normal, at);
  light += (1.0 - tint) * onLevel(LEVELS - 1, face, at);
#endif
  return light;
}

void main() {
  int row = int(gl_FragCoord.x) + 2048 * int(gl_FragCoord.y);
  if (texelFetch(wanted, ivec2(gl_FragCoord.xy), 0).r == 0u) discard;
  vec3 direction = unit(numbered(means, row).xyz - position);
  vec3 shown = max(0.5 + C0 * numbered(dc, row).xyz + seen(row, direction), 0.0);
  if (residual != 0.0) shown += residual * reflected(row, direction);
  color = uvec4(floatBitsToUint(shown), 0u);
}
