// One pixel: the ellipses of its tile front to back, until the light is used up; the twin of rasterize/reference.py.
uniform sampler2D ellipses;
uniform usampler2D tiles, entries;
uniform ivec2 size;
uniform int side;

const float MIN_ALPHA = 1.0 / 255.0, MAX_ALPHA = 0.999, MIN_TRANSMITTANCE = 1e-4;

// Row 0 is the picture's uppermost.
vec2 pixelCenter() { return vec2(gl_FragCoord.x, float(size.y) - gl_FragCoord.y); }

// Calls add(row, turned, weight, depth) for each ellipse that shows, and gives what is left of the light.
float blended() {
  vec2 pixel = pixelCenter();
  uvec2 span = texelFetch(tiles, ivec2(pixel) / side, 0).rg;
  float left = 1.0;
  for (uint entry = span.x; entry < span.x + span.y; entry++) {
    int place = 2 * int(texelFetch(entries, placed(int(entry)), 0).r);
    vec4 middle = numbered(ellipses, place), conic = numbered(ellipses, place + 1);
    vec2 d = pixel - middle.xy;
    float sigma = 0.5 * (conic.x * d.x * d.x + conic.z * d.y * d.y) + conic.y * d.x * d.y;
    float alpha = min(middle.z * exp(-sigma), MAX_ALPHA);
    if (sigma < 0.0 || alpha < MIN_ALPHA) continue;
    float next = left * (1.0 - alpha);
    if (next <= MIN_TRANSMITTANCE) break;
    add(int(abs(middle.w)) - 1, middle.w < 0.0, left * alpha, conic.w);
    left = next;
  }
  return left;
}
