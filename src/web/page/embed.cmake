# Makes a C++ source of the bytes of a file: the std::string_view NAME that HEADER declares.
file(READ ${FROM} bytes HEX)
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
