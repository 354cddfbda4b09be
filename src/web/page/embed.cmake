# Makes a C++ source of the bytes of a file: the std::string_view NAME that HEADER declares. With PARTS (name=file, of the
# file's folder) stylesheets and scripts that the file links by these names are written into it.
set(source ${FROM})
if(PARTS)
  get_filename_component(folder ${FROM} DIRECTORY)
  file(READ ${FROM} page)
  foreach(part ${PARTS})
    string(REGEX MATCH "^([^=]*)=(.*)$" ignored "${part}")
    set(name ${CMAKE_MATCH_1})
    file(READ ${folder}/${CMAKE_MATCH_2} content)
    string(REPLACE "<link rel=\"stylesheet\" href=\"${name}\">" "<style>\n${content}</style>" page "${page}")
    string(REPLACE "<script src=\"${name}\"></script>" "<script>\n${content}</script>" page "${page}")
  endforeach()
  if(page MATCHES "(href|src)=\"([a-z]+\\.(css|js))\"")
    message(FATAL_ERROR "${FROM} links ${CMAKE_MATCH_2}, which is not written into it")
  endif()
  set(source ${TO}.html)
  file(WRITE ${source} "${page}")
endif()
file(READ ${source} bytes HEX)
string(REGEX REPLACE "(..)" "'\\\\x\\1'," bytes "${bytes}")
string(REGEX REPLACE "(('[^']*',){24})" "\\1\n" bytes "${bytes}")
file(WRITE ${TO} "#include \"${HEADER}\"
namespace {
constexpr char kBytes[] = {
${bytes}
};
}
const std::string_view cloudrenderer::${NAME}{kBytes, sizeof kBytes};
")
