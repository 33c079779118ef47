// @ts-check
// The packed Gaussians are unpacked where they are projected. The projection, its low-pass and its cut-offs are those of
// the CPU rasteriser.

export const vertex = (/** @type {number} */ degree) => `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp sampler2D;
layout(location = 0) in uint index;
uniform usampler2D packed, paint, turns, harmonics;
uniform sampler2D table;
uniform mat3 axes; // columns right, down, forward
uniform vec3 eye;
uniform vec2 size;
uniform float focal, near;
out vec4 colour;
out vec2 offset;
flat out vec3 conic;

ivec2 place(uint n) { return ivec2(int(n & 2047u), int(n >> 11)); }

${degree === 0 ? '' : `
vec3 term(uint n, int k) { // coefficient k of Gaussian n, eight halves in a texel
  vec3 rgb;
  for (int c = 0; c < 3; c++) {
    int at = 3 * k + c;
    uvec4 texel = texelFetch(harmonics, place(n * ${((3 * (degree + 1) ** 2 + 7) >> 3)}u + uint(at >> 3)), 0);
    int word = (at >> 1) & 3;
    vec2 two = unpackHalf2x16(word == 0 ? texel.x : word == 1 ? texel.y : word == 2 ? texel.z : texel.w);
    rgb[c] = (at & 1) == 0 ? two.x : two.y;
  }
  return rgb;
}

vec4 turn_of(uint n) {
  uint word = texelFetch(turns, place(n), 0).r;
  vec3 three = (vec3(float(word & 1023u), float((word >> 10) & 1023u), float((word >> 20) & 1023u)) - 512.0) / (511.0 * sqrt(2.0));
  float rest = sqrt(max(0.0, 1.0 - dot(three, three)));
  uint largest = word >> 30;
  return largest == 0u ? vec4(rest, three) : largest == 1u ? vec4(three.x, rest, three.yz)
    : largest == 2u ? vec4(three.xy, rest, three.z) : vec4(three, rest);
}

vec3 seen(uint n, vec3 direction) {
  vec4 q = turn_of(n);
  vec3 t = 2.0 * cross(-q.xyz, direction);
  vec3 d = direction + q.w * t + cross(-q.xyz, t);
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  vec3 sum = vec3(0.5) + 0.2820948 * term(n, 0);
  sum += 0.4886025 * (z * term(n, 2) - y * term(n, 1) - x * term(n, 3));
  ${degree < 2 ? '' : `
  sum += 1.0925485 * (x * y * term(n, 4) - y * z * term(n, 5) - x * z * term(n, 7));
  sum += 0.31539157 * (2.0 * zz - xx - yy) * term(n, 6) + 0.54627424 * (xx - yy) * term(n, 8);`}
  ${degree < 3 ? '' : `
  sum += -0.5900436 * (y * (3.0 * xx - yy) * term(n, 9) + x * (xx - 3.0 * yy) * term(n, 15));
  sum += 2.8906114 * x * y * z * term(n, 10) + 1.4453057 * z * (xx - yy) * term(n, 14);
  sum += -0.4570458 * (4.0 * zz - xx - yy) * (y * term(n, 11) + x * term(n, 13));
  sum += 0.37317634 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * term(n, 12);`}
  return max(sum, 0.0);
}`}

float entry(uint bits) { return (float(bits & 4095u) - 2048.0) / 2047.0; }
float diagonal(uint bits) { return float(bits & 4095u) / 4095.0; }

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0); // outside, until it is seen
  uvec4 p = texelFetch(packed, place(index), 0);
  uint exponent = (p.y >> 16) & 255u;
  if (exponent == 0u) return;
  uvec2 own = texelFetch(paint, place(index), 0).rg;
  vec4 base = vec4(float(own.x & 255u), float((own.x >> 8) & 255u), float((own.x >> 16) & 255u), float(own.x >> 24)) / 255.0;
  if (base.a <= 1.0 / 255.0) return;
  int o = int(own.y);
  vec4 r0 = texelFetch(table, ivec2(2, o), 0), r1 = texelFetch(table, ivec2(3, o), 0), r2 = texelFetch(table, ivec2(4, o), 0);
  vec4 tint = texelFetch(table, ivec2(5, o), 0);
  if (tint.a < 0.0) return;
  vec3 local = texelFetch(table, ivec2(0, o), 0).xyz
    + texelFetch(table, ivec2(1, o), 0).xyz * vec3(float(p.x & 65535u), float(p.x >> 16), float(p.y & 65535u));
  vec3 world = vec3(dot(r0.xyz, local), dot(r1.xyz, local), dot(r2.xyz, local)) + vec3(r0.w, r1.w, r2.w);
  vec3 from = world - eye;
  vec3 view = from * axes;
  if (!(view.z >= near)) return;
  float unit = exp2(float(exponent) - 128.0);
  float l00 = diagonal((p.y >> 24) | (p.z << 8)), l10 = entry(p.z >> 4), l20 = entry(p.z >> 16);
  float l11 = diagonal((p.z >> 28) | (p.w << 4)), l21 = entry(p.w >> 8), l22 = diagonal(p.w >> 20);
  vec2 slope = view.xy / view.z;
  vec2 limit = 1.3 * 0.5 * size / focal;
  vec2 frozen = clamp(slope, -limit, limit);
  float scale = focal / view.z * unit;
  vec3 jx = (axes[0] - axes[2] * frozen.x) * scale, jy = (axes[1] - axes[2] * frozen.y) * scale;
  // Into the object's frame, then through the factor: the rows of the projected one.
  vec3 ox = r0.xyz * jx.x + r1.xyz * jx.y + r2.xyz * jx.z, oy = r0.xyz * jy.x + r1.xyz * jy.y + r2.xyz * jy.z;
  vec3 tx = vec3(dot(ox, vec3(l00, l10, l20)), ox.y * l11 + ox.z * l21, ox.z * l22);
  vec3 ty = vec3(dot(oy, vec3(l00, l10, l20)), oy.y * l11 + oy.z * l21, oy.z * l22);
  float xx = dot(tx, tx), yy = dot(ty, ty), a = xx + 0.3, c = yy + 0.3, b = dot(tx, ty);
  vec3 area = cross(tx, ty);
  float determinant = dot(area, area) + 0.3 * (xx + yy) + 0.09; // no difference of large numbers
  conic = vec3(c, -b, a) / determinant;
  float cutoff = sqrt(2.0 * log(base.a * 255.0));
  float middle = 0.5 * (a + c), spread = length(vec2(0.5 * (a - c), b));
  float major = middle + spread, minor = determinant / major;
  vec2 axis = spread < 1e-6 * middle ? vec2(1.0, 0.0) : normalize(abs(a - c) > 0.0 && a > c ? vec2(major - c, b) : vec2(b, major - a));
  vec2 corner = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1)) * 2.0 - 1.0;
  // Half a pixel more, so that every pixel whose centre is inside is covered.
  offset = corner.x * (cutoff * sqrt(major) + 0.5) * axis + corner.y * (cutoff * sqrt(minor) + 0.5) * vec2(-axis.y, axis.x);
  vec2 pixel = 0.5 * size + focal * slope + offset;
  gl_Position = vec4(pixel.x / size.x * 2.0 - 1.0, 1.0 - pixel.y / size.y * 2.0, 0.0, 1.0);
  vec3 rgb = ${degree === 0 ? 'base.rgb' : 'seen(index, normalize(from))'};
  colour = vec4(mix(rgb, tint.rgb, tint.a), base.a);
}`;

export const fragment = `#version 300 es
precision highp float;
in vec4 colour;
in vec2 offset;
flat in vec3 conic;
out vec4 light;
void main() {
  float power = conic.x * offset.x * offset.x + 2.0 * conic.y * offset.x * offset.y + conic.z * offset.y * offset.y;
  float alpha = min(0.99, colour.a * exp(-0.5 * power));
  if (alpha < 1.0 / 255.0) discard;
  light = vec4(colour.rgb * alpha, alpha);
}`;
