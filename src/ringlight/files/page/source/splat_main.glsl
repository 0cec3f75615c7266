out vec4 shown;
void main() {
  float left = blended(), alpha = 1.0 - left;
  vec3 color = layer == NORMAL ? normalPicture(sum, alpha) : layer == DEPTH ? depthPicture(sum.x, alpha) : sum + left * background;
  shown = vec4(color, 1.0);
}
