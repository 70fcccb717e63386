# cmake -DNM=nm -DLIST=abi.txt -DLIBRARY=libscree.so [-DARCHIVE=libscree.a] -P check_symbols.cmake: fails unless the library
# exports the functions of the list and nothing else, and the archive defines no other name that could clash with its
# user's.
file(STRINGS "${LIST}" expected REGEX "^function ")
list(TRANSFORM expected REPLACE "^function " "")
list(SORT expected)

function(defined out flags file pattern)
  execute_process(COMMAND "${NM}" ${flags} --defined-only "${file}" OUTPUT_VARIABLE text RESULT_VARIABLE failed)
  if(failed)
    message(FATAL_ERROR "nm ${file} failed")
  endif()
  string(REGEX MATCHALL "[0-9a-f]+ ${pattern} [^\n]+" lines "${text}")
  list(TRANSFORM lines REPLACE "^[0-9a-f]+ [A-Za-z] " "")
  list(TRANSFORM lines REPLACE "@.*$" "")
  list(FILTER lines EXCLUDE REGEX "^SCREE_[0-9]+$")  # the symbol of the names' version
  list(REMOVE_DUPLICATES lines)
  list(SORT lines)
  set(${out} "${lines}" PARENT_SCOPE)
endfunction()

defined(found "-D" "${LIBRARY}" "[A-Za-z]")
if(NOT found STREQUAL expected)
  message(FATAL_ERROR "${LIBRARY} exports\n  ${found}\nbut ${LIST} has\n  ${expected}")
endif()
if(ARCHIVE)
  defined(found "-g" "${ARCHIVE}" "[A-Za-z]")
  if(NOT found STREQUAL expected)
    message(FATAL_ERROR "${ARCHIVE} defines\n  ${found}\nbut ${LIST} has\n  ${expected}")
  endif()
endif()
