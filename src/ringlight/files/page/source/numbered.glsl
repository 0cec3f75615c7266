// Texels by number, as gl.js lays them out.
ivec2 placed(int number) { return ivec2(number & 2047, number >> 11); }
vec4 numbered(sampler2D texels, int number) { return texelFetch(texels, placed(number), 0); }

const float SMALLEST_LENGTH = 1e-12;
vec3 unit(vec3 v) { return v * inversesqrt(max(dot(v, v), SMALLEST_LENGTH * SMALLEST_LENGTH)); }

vec2 octahedral(vec3 v) {
  vec3 flat_ = v / max(abs(v.x) + abs(v.y) + abs(v.z), SMALLEST_LENGTH);
  vec2 signs = vec2(flat_.x >= 0.0 ? 1.0 : -1.0, flat_.y >= 0.0 ? 1.0 : -1.0);
  return flat_.z >= 0.0 ? flat_.xy : (1.0 - abs(flat_.yx)) * signs;
}

// The node at or below a coordinate in [-1, 1] and how far to the next one.
void cell(float at, int count, out int node, out float part) {
  float position = (clamp(at, -1.0, 1.0) + 1.0) * (0.5 * float(count - 1));
  node = min(int(position), count - 2);
  part = position - float(node);
}

// Beyond it some compilers' tanh is not a number; tanh(15) is 1 in 32 bit.
const float STEEPEST = 15.0;
vec4 flatTanh(vec4 x) { return tanh(clamp(x, -STEEPEST, STEEPEST)); }
