// Gaussians of a mirror: base colour, normal, latents and depth are blended; the light comes once per pixel.
// Texels a row: base colour, normal, then latents by four.
uniform sampler2D surfaces;
const int LATENT_TEXELS = (LATENTS + 3) / 4;
vec3 base = vec3(0.0), normal = vec3(0.0);
vec4 latents[LATENT_TEXELS + 1];
float depthSum = 0.0;

void add(int row, bool turned, float weight, float depth) {
  int first = row * (2 + LATENT_TEXELS);
  base += weight * numbered(surfaces, first).xyz;
  normal += (turned ? -weight : weight) * numbered(surfaces, first + 1).xyz;
  for (int k = 0; k < LATENT_TEXELS; k++) latents[k] += weight * numbered(surfaces, first + 2 + k);
  depthSum += weight * depth;
}
