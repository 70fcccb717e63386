# cmake -DFROM=source.cu -DTO=source.cpp -P convert.cmake: turns CUDA syntax that is not C++ into calls of device.h.
# Line numbers stay the same.
file(READ "${FROM}" text)
string(REGEX REPLACE "extern __shared__ ([A-Za-z_0-9:]+) ([a-z_0-9]+)\\[\\];"
  "auto* const \\2 = static_cast<\\1*>(::scree::emulator::dynamic_shared_memory());" text "${text}")
string(REGEX REPLACE "__shared__ ([A-Za-z_0-9:]+) ([a-z_0-9]+)((\\[[^]]*\\])*);"
  "auto& \\2 = ::scree::emulator::shared<\\1\\3, __COUNTER__>();" text "${text}")
string(REGEX REPLACE "([A-Za-z_][A-Za-z_0-9.:]*(<[A-Za-z_0-9:, ]*>)?)<<<(([^>]|>[^>])*)>>>[ \n]*\\("
  "::scree::emulator::launch(\"\\1\", \\1, \\3)(" text "${text}")
if(text MATCHES "(__shared__|<<<)[^\n]*")
  message(FATAL_ERROR "${FROM}: convert.cmake does not know what to make of: ${CMAKE_MATCH_0}")
endif()
file(WRITE "${TO}" "#line 1 \"${FROM}\"\n${text}")
