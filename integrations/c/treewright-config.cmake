# find_package(treewright) gives treewright::treewright (shared) and treewright::static.
get_filename_component(_treewright_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET treewright::treewright)
  add_library(treewright::treewright SHARED IMPORTED)
  set_target_properties(treewright::treewright PROPERTIES
    IMPORTED_LOCATION "${_treewright_prefix}/lib/libtreewright.so"
    INTERFACE_INCLUDE_DIRECTORIES "${_treewright_prefix}/include")
  find_package(Threads REQUIRED)
  add_library(treewright::static STATIC IMPORTED)
  set_target_properties(treewright::static PROPERTIES
    IMPORTED_LOCATION "${_treewright_prefix}/lib/libtreewright.a"
    INTERFACE_INCLUDE_DIRECTORIES "${_treewright_prefix}/include"
    INTERFACE_LINK_LIBRARIES "Threads::Threads;m;${CMAKE_DL_LIBS}")
endif()
unset(_treewright_prefix)
