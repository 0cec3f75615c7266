// Colours that are harmonics: the base colour is what the constant coefficient shows, the rest counts `residual` times.
void main() {
  int row = int(gl_FragCoord.x) + 2048 * int(gl_FragCoord.y);
  if (texelFetch(wanted, ivec2(gl_FragCoord.xy), 0).r == 0u) discard;
  vec3 constant = 0.5 + C0 * numbered(dc, row).xyz;
  vec3 direction = unit(numbered(means, row).xyz - position);
  color = uvec4(floatBitsToUint(max(constant + residual * seen(row, direction), 0.0)), 0u);
}
