# Makes a C++ source of the bytes of a file.
file(READ ${FROM} bytes HEX)
string(REGEX REPLACE "(..)" "'\\\\x\\1'," bytes "${bytes}")
string(REGEX REPLACE "(('[^']*',){24})" "\\1\n" bytes "${bytes}")
file(WRITE ${TO} "#include \"web/page.h\"
namespace {
constexpr char kBytes[] = {
${bytes}
};
}
const std::string_view cloudrenderer::kPage{kBytes, sizeof kBytes};
")
