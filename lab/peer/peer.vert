// Projects a vertex relative to the eye, with the arithmetic of spec/rasterization.md 2. VK-ID gets its position from
// the vertex fetch of an indexed draw; VK-PIP (PULLED) reads index and position from buffers itself.
#version 460
#extension GL_EXT_buffer_reference : require

struct Instance {  // lab/peer/vulkan_peer.cpp
  vec4 x, y, w;    // rows of clip space
  vec4 center;     // positions are taken relative to it
};
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Instances {
  Instance at[];
};
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer Positions {
  float at[];
};
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer Indices {
  uint at[];
};
layout(push_constant) uniform Draw {
  Instances instances;
  Positions positions;
  Indices indices;
} draw;

#ifndef PULLED
layout(location = 0) in vec3 fetched;
#endif
layout(location = 0) flat out uint row;

void main() {
#ifdef PULLED
  const uint vertex = 3 * draw.indices.at[gl_VertexIndex];
  const vec3 position =
      vec3(draw.positions.at[vertex], draw.positions.at[vertex + 1], draw.positions.at[vertex + 2]);
#else
  const vec3 position = fetched;
#endif
  const Instance instance = draw.instances.at[gl_InstanceIndex];
  const vec4 d = vec4(position - instance.center.xyz, 1);
  // w is 1 on the near plane, so z / w is 1 there and goes to 0 with the distance.
  gl_Position = vec4(dot(instance.x, d), dot(instance.y, d), 1, dot(instance.w, d));
  row = gl_InstanceIndex;
}
