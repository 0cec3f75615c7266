// Gaussians of a mirror: base colour, normal, latents and depth are blended; the light comes once per pixel.
// Texels a row: base colour, normal, then latents by four.
uniform sampler2D surfaces;
#if BASIS > 0
uniform usampler2D colors; // base colours as the camera sees them; those in `surfaces` are without a view
vec3 constant = vec3(0.0);
#endif
const int LATENT_TEXELS = (LATENTS + 3) / 4;
vec3 base = vec3(0.0), normal = vec3(0.0);
vec4 latents[LATENT_TEXELS + 1];
float depthSum = 0.0;

void add(int row, bool turned, float weight, float depth) {
  int first = row * (2 + LATENT_TEXELS);
#if BASIS > 0
  base += weight * uintBitsToFloat(texelFetch(colors, placed(row), 0).rgb);
  constant += weight * numbered(surfaces, first).xyz;
#else
  base += weight * numbered(surfaces, first).xyz;
#endif
  normal += (turned ? -weight : weight) * numbered(surfaces, first + 1).xyz;
  for (int k = 0; k < LATENT_TEXELS; k++) latents[k] += weight * numbered(surfaces, first + 2 + k);
  depthSum += weight * depth;
}
