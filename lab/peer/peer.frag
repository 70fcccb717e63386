// Writes the triangle that a sample shows: the row of its instance in the draw list, and its number in the mesh.
#version 460

layout(location = 0) flat in uint row;
layout(location = 0) out uvec2 id;

void main() {
  id = uvec2(row, gl_PrimitiveID);
}
