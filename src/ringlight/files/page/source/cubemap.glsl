// Where directions fall on a cubemap; the twin of cubemap_places() in fields/cubemap.py.
const ivec2 OTHERS[3] = ivec2[3](ivec2(1, 2), ivec2(0, 2), ivec2(0, 1));

// The face of a direction, and column and row on it from 0 to 1.
int faceOf(vec3 v, out vec2 at) {
  vec3 size = abs(v);
  int axis = size.x >= size.y ? (size.x >= size.z ? 0 : 2) : (size.y >= size.z ? 1 : 2);
  at = vec2(v[OTHERS[axis].x], v[OTHERS[axis].y]) / size[axis] * 0.5 + 0.5;
  return 2 * axis + (v[axis] < 0.0 ? 1 : 0);
}
