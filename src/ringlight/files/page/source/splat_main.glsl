out vec4 shown;
void main() {
  float left = blended(), alpha = 1.0 - left;
  vec3 color = sum + left * background;
  if (layer == NORMAL) color = normalPicture(sum, alpha);
  else if (layer == DEPTH) color = depthPicture(sum.x, alpha);
  shown = vec4(color, 1.0);
}
