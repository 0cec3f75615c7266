// What a pixel reflects; the twin of shade/environment.py and of looked_up() in fields/cubemap.py.
uniform sampler2D environment;
uniform float light;
out vec4 shown;

const int WIDE = ENVIRONMENT_SIDE + 2;

vec3 environmentAt(vec3 v) {
  vec2 at;
  int face = faceOf(v, at);
  at = at * float(ENVIRONMENT_SIDE) + 0.5;
  ivec2 corner = clamp(ivec2(floor(at)), 0, WIDE - 2), first = corner + ivec2(0, face * WIDE);
  vec2 part = at - vec2(corner);
  vec3 upper = mix(texelFetch(environment, first, 0), texelFetch(environment, first + ivec2(1, 0), 0), part.x).rgb;
  vec3 lower =
    mix(texelFetch(environment, first + ivec2(0, 1), 0), texelFetch(environment, first + ivec2(1, 1), 0), part.x).rgb;
  return mix(upper, lower, part.y);
}

void main() {
  float left = blended(), alpha = 1.0 - left;
  vec3 color = base + left * background;
  if (layer == NORMAL) color = normalPicture(normal, alpha);
  else if (layer == DEPTH) color = depthPicture(depthSum, alpha);
  else if (alpha > FAINTEST_SHADED && light != 0.0) {
    vec3 ray = pixelRay(), direction = ray * inversesqrt(dot(ray, ray));
    color += light * strength * (environmentAt(mirrored(direction, surfaceNormal())) - color);
  }
  shown = vec4(color, 1.0);
}
