// One program draws every surface: three vertices a face without an index, so that faces have values of their own and
// flat shading needs no normals. What belongs to a vertex or a face lies in textures WIDTH texels wide.

import { CLAY, Color, INSIDE, PINNED, UNKNOWN } from "./colors";

export const WIDTH = 2048;
export const NOTHING = -3e38; // stands for NaN, which a texture need not keep
export const PIN = -1e38; // stands for a vertex that stays

const vec3 = (color: Color) => `vec3(${color.join(".0, ")}.0) / 255.0`;

export const vertexShader = `
precision highp float;
precision highp int;
precision highp sampler2D;

uniform mat4 modelViewMatrix;
uniform mat4 projectionMatrix;
uniform sampler2D positions;
uniform sampler2D normals;
uniform sampler2D values;
uniform sampler2D colors;
uniform bool atFaces;
uniform bool hasValues;
uniform bool hasColors;
uniform bool smoothShading;

in uint corner;

out vec3 place;
out vec3 normal;
out vec3 weights;
out vec3 vertexColor;
out float value;
out float known;
out float pinned;
flat out int face;

ivec2 texel(int index) { return ivec2(index % ${WIDTH}, index / ${WIDTH}); }

void main() {
  ivec2 vertex = texel(int(corner));
  face = gl_VertexID / 3;
  int k = gl_VertexID % 3;
  weights = vec3(k == 0, k == 1, k == 2);
  vec4 eye = modelViewMatrix * vec4(texelFetch(positions, vertex, 0).xyz, 1.0);
  place = eye.xyz;
  normal = smoothShading ? mat3(modelViewMatrix) * texelFetch(normals, vertex, 0).xyz : vec3(0.0, 0.0, 1.0);
  vertexColor = hasColors ? texelFetch(colors, vertex, 0).rgb : vec3(0.0);
  float stored = hasValues ? texelFetch(values, atFaces ? texel(face) : vertex, 0).r : ${NOTHING};
  known = stored > ${NOTHING} * 0.5 ? 1.0 : 0.0;
  pinned = known > 0.5 && stored < ${PIN} * 0.5 ? 1.0 : 0.0;
  value = known > 0.5 && pinned < 0.5 ? stored : 0.0;
  gl_Position = projectionMatrix * eye;
}
`;

export const fragmentShader = `
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D colorMap;
uniform bool hasValues;
uniform bool hasColors;
uniform bool smoothShading;
uniform bool wireframe;
uniform bool hasRange;
uniform vec2 limits;
uniform vec2 range;
uniform int light;
uniform float angle;
uniform int picked;
uniform vec3 accent;

in vec3 place;
in vec3 normal;
in vec3 weights;
in vec3 vertexColor;
in float value;
in float known;
in float pinned;
flat in int face;

out vec4 color;

const vec3 CLAY = ${vec3(CLAY)};
const vec3 INSIDE = ${vec3(INSIDE)};
const vec3 UNKNOWN = ${vec3(UNKNOWN)};
const vec3 PINNED = ${vec3(PINNED)};

vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 encoded(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

// a light at the viewer and one from the upper left, as in the pictures of cascadenorm.render
float clay(vec3 n) {
  return 0.05 + 0.34 * max(n.z, 0.0) + 0.62 * max(dot(n, normalize(vec3(-0.45, 0.72, 0.53))), 0.0);
}

// nearly along the surface that faces the viewer, so that slight changes of its direction are seen
float raking(vec3 n) {
  vec3 from = normalize(vec3(cos(angle), sin(angle), 0.22));
  return 0.03 + 0.10 * max(n.z, 0.0) + 1.05 * max(dot(n, from), 0.0);
}

// a ball of glazed clay in a studio: sky above, floor below, a window, a bright rim
vec3 matcap(vec3 n, vec3 surface) {
  float up = 0.5 + 0.5 * n.y;
  vec3 body = surface * mix(vec3(0.20, 0.19, 0.20), vec3(0.85, 0.88, 0.92), up * up * (3.0 - 2.0 * up)) * (0.35 + 0.65 * n.z);
  float window = pow(max(dot(n, normalize(vec3(-0.35, 0.55, 0.76))), 0.0), 24.0);
  float rim = pow(1.0 - clamp(n.z, 0.0, 1.0), 3.0);
  return body + 0.35 * window + 0.16 * rim * up;
}

void main() {
  vec3 n = normalize(cross(dFdx(place), dFdy(place)));
  if (smoothShading && dot(normal, normal) > 0.0) {
    n = gl_FrontFacing ? normalize(normal) : -normalize(normal);
  }
  vec3 surface = linear(gl_FrontFacing ? CLAY : INSIDE);
  bool painted = hasValues || hasColors;
  if (hasColors) surface = linear(vertexColor);
  if (hasValues) {
    float at = clamp((value - limits.x) / (limits.y - limits.x), 0.0, 1.0);
    vec3 coded = pinned > 0.5 ? PINNED : texture(colorMap, vec2((at * 255.0 + 0.5) / 256.0, 0.5)).rgb;
    surface = linear(known > 0.999 ? coded : UNKNOWN);
    if (hasRange && !(known > 0.999 && value >= range.x && value <= range.y)) {
      surface = mix(vec3(dot(surface, vec3(0.2126, 0.7152, 0.0722))), vec3(0.55), 0.75);
    }
  }
  vec3 lit = surface;
  if (light == 1) {
    lit = matcap(n, surface);
  } else if (light != 3) {
    float strength = light == 2 ? raking(n) : clay(n);
    lit = surface * (painted && light == 0 ? 0.5 + 0.5 * strength : strength);
  }
  vec3 shown = encoded(lit);
  if (wireframe) {
    vec3 width = fwidth(weights);
    vec3 away = smoothstep(0.4 * width, 1.4 * width, weights);
    shown = mix(mix(shown, vec3(0.06, 0.07, 0.09), 0.75), shown, min(away.x, min(away.y, away.z)));
  }
  if (face == picked) shown = mix(shown, accent, 0.8);
  color = vec4(shown, 1.0);
}
`;
