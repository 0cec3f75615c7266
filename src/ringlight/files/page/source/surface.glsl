// The ray of a pixel and the unit normal that it meets; the twin of shade/covered.py.
uniform mat3 toWorld;
uniform vec2 focal, center;

const float FAINTEST_SHADED = 0.02, SHORTEST_NORMAL = 1e-3;

vec3 pixelRay() { return toWorld * vec3((pixelCenter() - center) / focal, 1.0); }
vec3 surfaceNormal() { return normal * inversesqrt(max(dot(normal, normal), SHORTEST_NORMAL * SHORTEST_NORMAL)); }
vec3 mirrored(vec3 direction, vec3 n) { return direction - 2.0 * dot(direction, n) * n; }
