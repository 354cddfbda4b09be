// Broken scenes of every kind: each ends with an error at its place, or with warnings and a picture.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <zlib.h>

#include "cli_scene_support.h"
#include "images/images.h"
#include "scene/language.h"

namespace cloudrenderer {
namespace {

enum class End { error, picture };

struct Broken {
  End end;
  const char* says;  // a piece of the error, or of a warning; "": there is none
  std::string text;
};

constexpr const char* kTriangle = "\"integer indices\" [0 1 2] \"point P\" [0 0 0 1 0 0 0 1 0]";

std::string world(const std::string& body) { return "WorldBegin\n" + body + "\nWorldEnd\n"; }
std::string shape(const std::string& rest) { return world("Shape " + rest); }
std::string options(const std::string& before) { return before + "\nWorldBegin WorldEnd\n"; }
std::string material(const std::string& rest) {
  return world("Material " + rest + "\nShape \"trianglemesh\" " + kTriangle);
}
std::string texture(const std::string& rest) {
  return world("Texture \"x\" \"spectrum\" " + rest +
               "\nMaterial \"matte\" \"texture Kd\" \"x\"\nShape \"trianglemesh\" " + kTriangle);
}
std::string repeat(const std::string& s, std::size_t n) {
  std::string out;
  for (std::size_t i = 0; i < n; ++i) out += s;
  return out;
}
std::string gzip(const std::string& text) {
  std::string out(compressBound(text.size()) + 64, '\0');
  z_stream z{};
  deflateInit2(&z, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  z.avail_in = static_cast<uInt>(text.size());
  z.next_out = reinterpret_cast<Bytef*>(out.data());
  z.avail_out = static_cast<uInt>(out.size());
  deflate(&z, Z_FINISH);
  out.resize(z.total_out);
  deflateEnd(&z);
  return out;
}

std::vector<Broken> scenes() {
  const auto E = End::error, P = End::picture;
  return {
      // files
      {E, "no WorldBegin", ""},
      {E, "unknown directive 'PK", std::string("PK\x03\x04 binary")},
      {E, "error: ", std::string("\x7f" "ELF\0\1\2\3", 8)},
      {E, "gzip data end too early", gzip(world("")).substr(0, 20)},
      {E, "damaged gzip", std::string("\x1f\x8b\x08\0\0\0\0\0\0\0garbage", 17)},
      {P, "", gzip(world(""))},
      {P, "", "\xef\xbb\xbf" + world("")},
      {P, "", "WorldBegin\r\nShape \"sphere\"\r\nWorldEnd\r\n"},
      {P, "no object \"\xc3\xa4\"", world("ObjectInstance \"\xc3\xa4\"")},
      {E, "cannot read", world("Include \"nowhere.pbrt\"")},
      {E, "includes itself", world("Include \"scene.pbrt\"")},
      {E, "not a regular file", world("Include \".\"")},
      {E, "expected the name of a file", world("Include 5")},
      {P, "no object", world("Include \"part.pbrt\"")},
      // blocks
      {E, "WorldEnd without WorldBegin", "WorldEnd"},
      {P, "AttributeEnd without AttributeBegin", world("AttributeEnd")},
      {P, "TransformEnd without TransformBegin", world("TransformEnd")},
      {P, "ObjectEnd without ObjectBegin", world("ObjectEnd")},
      {P, "AttributeEnd is missing", world("AttributeBegin")},
      {P, "TransformEnd is missing", world("TransformBegin")},
      {P, "ObjectEnd is missing", world("ObjectBegin \"a\"")},
      {P, "inside of an object", world("ObjectBegin \"a\" ObjectBegin \"b\" ObjectEnd ObjectEnd")},
      {P, "not complete", world("ObjectBegin \"a\" ObjectInstance \"a\" ObjectEnd")},
      {P, "is defined again", world("ObjectBegin \"a\" ObjectEnd ObjectBegin \"a\" ObjectEnd")},
      {P, "no object \"x\"", world("ObjectInstance \"x\"")},
      {E, "nested too deep", world(repeat("AttributeBegin\n", 30000))},
      {E, "nested too deep", world(repeat("TransformBegin\n", 30000))},
      {P, "ends without WorldEnd", "WorldBegin"},
      {P, "only the first world", world("") + world("")},
      {P, "WorldBegin inside", world("WorldBegin")},
      {P, "before WorldBegin", "Shape \"sphere\"\n" + world("")},
      {P, "after WorldBegin", world("Film \"image\"")},
      // tokens
      {E, "unknown directive 'Shpae'", world("Shpae \"sphere\"")},
      {E, "expected a directive", world("\"sphere\"")},
      {E, "expected a directive", world("17")},
      {E, "expected a directive", world("[")},
      {E, "string does not end", world("Shape \"sphere")},
      {E, "expected a type", world("Shape")},
      {E, "expected a type", world("Shape sphere")},
      {P, "types are float", shape("\"sphere\" \"flaot radius\" 1")},
      {E, "has no name", shape("\"sphere\" \"float\" 1")},
      {E, "expected a number", shape("\"sphere\" \"float radius\"")},
      {E, "expected a number", shape("\"sphere\" \"float radius\" [1 [2]]")},
      {E, "found the end", "WorldBegin Shape \"sphere\" \"float radius\" [1"},
      {E, "nan", shape("\"sphere\" \"float radius\" nan")},
      {E, "inf", shape("\"sphere\" \"float radius\" [inf]")},
      {E, "is not a number", shape("\"sphere\" \"float radius\" 1.2.3")},
      {E, "too large", shape("\"trianglemesh\" \"point P\" [1 2 1e99]")},
      {E, "32 bits", shape("\"trianglemesh\" \"integer indices\" [0 1 99999999999]")},
      {E, "the string is too long", shape("\"sphere\" \"float " + std::string(100000, 'r') + "\" 1")},
      {E, "the string is too long", shape("\"" + std::string(100000, 's') + "\"")},
      {E, "more than 1000 parameters", [] {
         std::string s = "\"sphere\"";
         for (int i = 0; i < 1100; ++i) s += " \"float p" + std::to_string(i) + "\" 1";
         return shape(s);
       }()},
      // transformations
      {E, "expected a number", world("Translate 1 2")},
      {E, "expected a number", world("Scale \"x\" 1 1")},
      {E, "expected a number", world("Transform [1 0 0]")},
      {E, "expected ']'", world("Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 5]")},
      {E, "too large", world("Scale 1e300 1 1")},
      {E, "too large", world("Scale 1e30 1 1\nScale 1e30 1 1")},
      {P, "ignored", world("Rotate 30 0 0 0")},
      {P, "ignored", "LookAt 0 0 0 0 0 0 0 1 0\n" + world("")},
      {P, "ignored", "LookAt 0 0 0 0 0 1 0 0 1\n" + world("")},
      {P, "cannot be inverted", world("Scale 0 1 1 Shape \"sphere\"")},
      {P, "cannot be inverted", world("ObjectBegin \"a\" Shape \"sphere\" ObjectEnd Scale 0 0 0 ObjectInstance \"a\"")},
      {E, "cannot be inverted", world("Scale 1 0 1 LightSource \"point\"")},
      {E, "cannot be inverted", "Scale 0 1 1 Camera \"perspective\"\n" + world("")},
      {P, "no coordinate system", world("CoordSysTransform \"elsewhere\"")},
      // shapes
      {P, "radius must be > 0, got 0: the shape is left out", shape("\"sphere\" \"float radius\" 0")},
      {P, "radius", shape("\"sphere\" \"float radius\" -2")},
      {P, "the shape is not finite", shape("\"sphere\" \"float radius\" 1e38")},
      {P, "zmin and zmax", shape("\"sphere\" \"float zmin\" 2 \"float zmax\" 3")},
      {P, "zmin and zmax", shape("\"sphere\" \"float zmin\" 1 \"float zmax\" 1")},
      {P, "phimax", shape("\"sphere\" \"float phimax\" 0")},
      {P, "is of type string, not float: ignored", shape("\"sphere\" \"string radius\" \"1\"")},
      {P, "has 2 values, not one: ignored", shape("\"sphere\" \"float radius\" [1 2]")},
      {P, "has 0 values, not one: ignored", shape("\"sphere\" \"float radius\" []")},
      {P, "\"radius\" is not of type float: ignored", shape("\"sphere\" \"float radius\" \"1\"")},
      {P, "\"radius\" is not of type float: ignored", shape("\"sphere\" \"float radius\" [ \"1\" \"2\" ]")},
      {P, "\"filename\" is not of type string: ignored", options("Film \"image\" \"string filename\" 5")},
      {P, "unknown renderer", options("Renderer \"gpu\"")},
      {P, "unknown accelerator", options("Accelerator \"octree\"")},
      {E, "UTF-16", std::string("\xff\xfeW\0o\0", 6)},
      {P, "is it \"radius\"", shape("\"sphere\" \"float raduis\" 1")},
      {P, "radius", shape("\"cylinder\" \"float radius\" 0")},
      {P, "radius", shape("\"disk\" \"float radius\" 0")},
      {P, "innerradius", shape("\"disk\" \"float innerradius\" 2")},
      {P, "radius", shape("\"cone\" \"float radius\" -1")},
      {P, "height", shape("\"cone\" \"float height\" 0")},
      {P, "", shape("\"paraboloid\" \"float zmin\" 1 \"float zmax\" 0")},
      {P, "hyperboloid", shape("\"hyperboloid\" \"point p1\" [0 0 0] \"point p2\" [0 0 0]")},
      {P, "", shape("\"trianglemesh\" \"integer indices\" [0 0 0] \"point P\" [0 0 0]")},
      {P, "", shape("\"trianglemesh\" \"integer indices\" [0 1 2] \"point P\" [0 0 0 0 0 0 0 0 0]")},
      {E, "indices", shape("\"trianglemesh\" \"point P\" [0 0 0]")},
      {E, "P", shape("\"trianglemesh\" \"integer indices\" [0 1 2]")},
      {E, "not one of the 3 vertices", shape("\"trianglemesh\" \"integer indices\" [0 1 3] \"point P\" [0 0 0 1 0 0 0 1 0]")},
      {E, "not one of the 3 vertices", shape("\"trianglemesh\" \"integer indices\" [0 1 -1] \"point P\" [0 0 0 1 0 0 0 1 0]")},
      {E, "below 1e18", shape("\"trianglemesh\" \"integer indices\" [0 1 2] \"point P\" [0 0 0 1e30 0 0 0 1 0]")},
      {P, "normals", shape(std::string("\"trianglemesh\" ") + kTriangle + " \"normal N\" [0 0 1]")},
      {P, "uvs", shape(std::string("\"trianglemesh\" ") + kTriangle + " \"float uv\" [0 0]")},
      {P, "ignored", shape("\"trianglemesh\" \"integer indices\" [0 1 2] \"point P\" [0 0 0 1 0 0 0 1 0 7]")},
      {P, "indices", shape("\"trianglemesh\" \"integer indices\" [0 1 2 0] \"point P\" [0 0 0 1 0 0 0 1 0]")},
      {E, "levels", shape("\"loopsubdiv\" \"integer nlevels\" 2000000000 \"integer indices\" [0 1 2] \"point P\" [0 0 0 1 0 0 0 1 0]")},
      {E, "levels", shape("\"loopsubdiv\" \"integer nlevels\" -1 \"integer indices\" [0 1 2] \"point P\" [0 0 0 1 0 0 0 1 0]")},
      {E, "not one of", shape("\"loopsubdiv\" \"integer indices\" [0 1 9] \"point P\" [0 0 0 1 0 0 0 1 0]")},
      {E, "needs 4000000000000000000 heights", shape("\"heightfield\" \"integer nu\" 2000000000 \"integer nv\" 2000000000 \"float Pz\" [1]")},
      {E, "nu", shape("\"heightfield\" \"integer nu\" -1 \"integer nv\" 2 \"float Pz\" [1]")},
      {E, "needs 4 heights, got 3", shape("\"heightfield\" \"integer nu\" 2 \"integer nv\" 2 \"float Pz\" [1 2 3]")},
      {E, "needs nu and nv", shape("\"heightfield\" \"float nu\" 2")},
      {P, "known shapes are", shape("\"teapot\"")},
      {E, "filename", shape("\"plymesh\"")},
      {E, "cannot read", shape("\"plymesh\" \"string filename\" \"nowhere.ply\"")},
      {E, "empty.ply", shape("\"plymesh\" \"string filename\" \"empty.ply\"")},
      {E, "binary.ply", shape("\"plymesh\" \"string filename\" \"binary.ply\"")},
      {E, "short.ply", shape("\"plymesh\" \"string filename\" \"short.ply\"")},
      {E, "huge.ply", shape("\"plymesh\" \"string filename\" \"huge.ply\"")},
      {E, "index.ply", shape("\"plymesh\" \"string filename\" \"index.ply\"")},
      {E, "cut.ply.gz", shape("\"plymesh\" \"string filename\" \"cut.ply.gz\"")},
      {P, "", shape("\"plymesh\" \"string filename\" \"good.ply.gz\"")},
      {E, "not a regular file", shape("\"plymesh\" \"string filename\" \".\"")},
      {P, "no texture \"holes\"", shape(std::string("\"trianglemesh\" ") + kTriangle + " \"texture alpha\" \"holes\"")},
      // materials
      {P, "is unknown: matte is used", material("\"velvet\"")},
      {P, "has no parameter \"kd\": ignored; is it \"Kd\"?", material("\"matte\" \"rgb kd\" [1 1 1]")},
      {P, "is of type point, not spectrum: ignored", material("\"matte\" \"point Kd\" [1 1 1]")},
      {P, "has 2 values, not one: ignored", material("\"matte\" \"rgb Kd\" [1 1 1 1 1 1]")},
      {E, "no multiple of 3", material("\"matte\" \"rgb Kd\" [1 1]")},
      {P, "no texture \"wood\"", material("\"matte\" \"texture Kd\" \"wood\"")},
      {P, "has 2 values, not one: ignored", material("\"matte\" \"texture Kd\" [\"a\" \"b\"]")},
      {P, "", material("\"matte\" \"rgb Kd\" [-1 -1 -1]")},
      {P, "", material("\"matte\" \"rgb Kd\" [1e30 1e30 1e30]")},
      {P, "", material("\"glass\" \"float index\" 0")},
      {P, "", material("\"plastic\" \"float roughness\" -1")},
      {P, "no material \"a\"", material("\"mix\" \"string namedmaterial1\" \"a\"")},
      {P, "no material \"m\"", world("MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string namedmaterial1\" \"m\" \"string namedmaterial2\" \"m\"")},
      {E, "more than 8 deep", [] {
         std::string s = "MakeNamedMaterial \"m0\" \"string type\" \"matte\"\n";
         for (int i = 1; i < 12; ++i)
           s += "MakeNamedMaterial \"m" + std::to_string(i) + "\" \"string type\" \"mix\" \"string namedmaterial1\" \"m" +
                std::to_string(i - 1) + "\" \"string namedmaterial2\" \"m" + std::to_string(i - 1) + "\"\n";
         return world(s + "NamedMaterial \"m11\" Shape \"sphere\"");
       }()},
      {P, "without \"string type\"", world("MakeNamedMaterial \"m\"")},
      {P, "no material \"x\"", world("NamedMaterial \"x\" Shape \"sphere\"")},
      {E, "measured material needs", material("\"measured\"")},
      {E, "cannot read", material("\"measured\" \"string filename\" \"nowhere.brdf\"")},
      {E, "empty.ply", material("\"measured\" \"string filename\" \"empty.ply\"")},
      {P, "there is no spectrum file 'nowhere.spd': black is used", material("\"metal\" \"spectrum eta\" \"nowhere.spd\"")},
      {E, "empty.ply", material("\"metal\" \"spectrum eta\" \"empty.ply\"")},
      {E, "pairs of wavelength", material("\"metal\" \"spectrum eta\" []")},
      {P, "has no value", material("\"metal\" \"spectrum eta\" [400 1 500]")},
      {P, "", material("\"matte\" \"blackbody Kd\" [-5 1]")},
      {P, "", material("\"matte\" \"blackbody Kd\" [1e30 1]")},
      // textures
      {P, "unknown texture", texture("\"plaid\"")},
      {E, "expected", world("Texture \"x\"")},
      {P, "needs a \"string filename\"", texture("\"imagemap\"")},
      {P, "has 2 values, not one", texture("\"imagemap\" \"string filename\" [\"a.png\" \"b.png\"]")},
      {P, "a texture must be \"float\" or \"spectrum\", found \"rgb\": ignored", world("Texture \"x\" \"rgb\" \"constant\"")},
      {P, "nowhere.png", texture("\"imagemap\" \"string filename\" \"nowhere.png\"")},
      {P, "empty.ply", texture("\"imagemap\" \"string filename\" \"empty.ply\"")},
      {P, "broken.png", texture("\"imagemap\" \"string filename\" \"broken.png\"")},
      {P, "not a regular file", texture("\"imagemap\" \"string filename\" \"/dev/zero\"")},
      {P, "not a regular file", world("LightSource \"infinite\" \"string mapname\" \"/dev/zero\"")},
      {P, "unknown wrap", texture("\"imagemap\" \"string filename\" \"good.ppm\" \"string wrap\" \"twist\"")},
      {P, "unknown texture mapping", texture("\"uv\" \"string mapping\" \"conical\"")},
      {E, "dimension must be 2 or 3", texture("\"checkerboard\" \"integer dimension\" 4")},
      {P, "octaves", texture("\"fbm\" \"integer octaves\" 2000000000")},
      {P, "no texture \"x\"", texture("\"scale\" \"texture tex1\" \"x\"")},
      {E, "more than 64 deep", [] {
         std::string s = "\"uv\"\n";
         for (int i = 0; i < 80; ++i) s += "Texture \"x\" \"spectrum\" \"scale\" \"texture tex1\" \"x\"\n";
         return texture(s);
       }()},
      // lights
      {P, "not supported and left out", world("LightSource \"torch\"")},
      {P, "has no parameter", world("LightSource \"point\" \"rgb L\" [1 1 1]")},
      {E, "needs a direction", world("LightSource \"distant\" \"point from\" [0 0 0] \"point to\" [0 0 0]")},
      {E, "needs a direction", world("LightSource \"spot\" \"point from\" [1 1 1] \"point to\" [1 1 1]")},
      {E, "must be finite", world("LightSource \"point\" \"rgb I\" [1e30 1 1] \"rgb scale\" [1e30 1 1]")},
      {P, "cannot be read", world("LightSource \"infinite\" \"string mapname\" \"nowhere.exr\"")},
      {P, "cannot be read", world("LightSource \"infinite\" \"string mapname\" \"broken.png\"")},
      {E, "fov", world("LightSource \"projection\" \"float fov\" 180")},
      {P, "does not shine", world("AreaLightSource \"glowing\" Shape \"sphere\"")},
      {P, "area lights inside of objects", world("ObjectBegin \"a\" AreaLightSource \"diffuse\" Shape \"sphere\" ObjectEnd ObjectInstance \"a\"")},
      {P, "2:1: warning: the light's L has negative channels", world("AreaLightSource \"diffuse\" \"rgb L\" [-1 -1 -1] Shape \"sphere\"")},
      {P, "", world("AreaLightSource \"diffuse\" Shape \"trianglemesh\" \"integer indices\" [0 1 2] \"point P\" [0 0 0 0 0 0 0 0 0]")},
      // options
      {P, "camera \"fisheye\" is not supported", options("Camera \"fisheye\"")},
      {E, "fov", options("Camera \"perspective\" \"float fov\" 0")},
      {E, "fov", options("Camera \"perspective\" \"float fov\" 180")},
      {E, "lensradius", options("Camera \"perspective\" \"float lensradius\" -1")},
      {E, "focaldistance", options("Camera \"perspective\" \"float lensradius\" .1 \"float focaldistance\" 0")},
      {P, "", options("Camera \"perspective\" \"float lensradius\" 0 \"float focaldistance\" 0")},
      {P, "screenwindow must have 4 values", options("Camera \"perspective\" \"float screenwindow\" [-1 1]")},
      {P, "cropwindow must have 4 values", options("Film \"image\" \"float cropwindow\" [0 1]")},
      {P, "", options("SurfaceIntegrator \"path\" \"integer maxdepth\" -1")},
      {P, "", options("Integrator \"path\" \"integer maxdepth\" 1000000")},
      {P, "", options("Integrator \"directlighting\" \"integer maxdepth\" -1")},
      {P, "", "SurfaceIntegrator \"path\" \"integer maxdepth\" -1\nSampler \"random\" \"integer pixelsamples\" 1\n" +
                  world("Material \"mirror\" \"color Kr\" [1 1 1] Shape \"sphere\"")},
      {P, "parameter \"radius\" is not a number (nan): ignored", shape("\"sphere\" \"float radius\" [-nan(ind)]")},
      {E, "found 'nanometer'", shape("\"sphere\" \"float radius\" [1 nanometer]")},
      {P, "normals are not finite", shape(std::string("\"trianglemesh\" \"normal N\" [nan nan nan 0 0 1 0 0 -nan(ind)] ") + kTriangle)},
      {P, "is of type vector, not point: ignored", world("LightSource \"point\" \"vector from\" [0 0 1]")},
      {P, "is of type rgb, not point: ignored", world("LightSource \"distant\" \"rgb from\" [0 0 1]")},
      {P, "\"True\" of parameter \"twosided\" is not true or false: false is used",
       "Integrator \"path\"\n" + world("AreaLightSource \"diffuse\" \"bool twosided\" \"True\"")},
      {E, "screenwindow", options("Camera \"perspective\" \"float screenwindow\" [0 0 0 0]")},
      {E, "frameaspectratio", options("Camera \"perspective\" \"float frameaspectratio\" 0")},
      {E, "xresolution", options("Film \"image\" \"integer xresolution\" 0")},
      {E, "xresolution", options("Film \"image\" \"integer xresolution\" 2000000000")},
      {E, "2^32 pixels", options("Film \"image\" \"integer xresolution\" 65536 \"integer yresolution\" 65536")},
      {P, "film hologram is unknown", options("Film \"hologram\"")},
      {P, ".png or .tga", options("Film \"image\" \"string filename\" \"picture.bmp\"")},
      {P, "is not known", options("Sampler \"psychic\"")},
      {E, "pixelsamples", options("Sampler \"random\" \"integer pixelsamples\" 0")},
      {E, "pixelsamples", options("Sampler \"random\" \"integer pixelsamples\" 2000000000")},
      {P, "is unknown, \"box\" is used", options("PixelFilter \"wavelet\"")},
      {E, "xwidth", options("PixelFilter \"box\" \"float xwidth\" 0")},
      {E, "xwidth", options("PixelFilter \"box\" \"float xwidth\" 1e30")},
      {E, "tau", options("PixelFilter \"sinc\" \"float tau\" 0")},
      {E, "is not supported; known are", options("SurfaceIntegrator \"magic\"")},
      {E, "nsamples", options("SurfaceIntegrator \"ambientocclusion\" \"integer nsamples\" 0")},
      {P, "ignored", options("Camera \"perspective\" \"texture fov\" \"x\"")},
  };
}

// pbrt-v4's own.
std::vector<Broken> scenes_of_v4() {
  const auto E = End::error, P = End::picture;
  const auto w = [](const std::string& body) { return "WorldBegin\n" + body + "\n"; };
  const auto o = [](const std::string& before) { return before + "\nWorldBegin\n"; };
  return {
      {E, "unknown colour space", o("ColorSpace \"cmyk\"")},
      {E, "expected the name of a colour space", o("ColorSpace 5")},
      {E, "an attribute is of", w("Attribute \"weather\" \"float rain\" 1")},
      {E, "expected what the attribute is of", w("Attribute")},
      {E, "expected an option", o("Option")},
      {P, "option \"wavefront\" is ignored", o("Option \"bool wavefront\" true")},
      {E, "cannot read", w("Import \"nowhere.pbrt\"")},
      {E, "includes itself", w("Import \"scene.pbrt\"")},
      {E, "there is no spectrum", w("Material \"conductor\" \"spectrum eta\" \"metal-Xx-eta\"")},
      {E, "no multiple of 3", w("Material \"diffuse\" \"rgb reflectance\" [1 1]")},
      {E, "mix needs", w("Material \"mix\"")},
      {E, "mix needs", w("Material \"mix\" \"string materials\" \"a\"")},
      {P, "no material \"a\"", w("Material \"mix\" \"string materials\" [\"a\" \"b\"]")},
      {P, "is unknown: diffuse is used", w("Material \"principled\" Shape \"sphere\"")},
      {P, "its grid is not loaded", w("MakeNamedMedium \"m\" \"string type\" \"uniformgrid\" \"float density\" 1 Shape \"sphere\"")},
      {P, "smaller than the box of its grid", w("MakeNamedMedium \"m\" \"string type\" \"uniformgrid\" \"float density\" 1 MediumInterface \"m\" \"\" Material \"dielectric\" Shape \"sphere\" \"float radius\" .1")},
      {P, "\"L\" is ignored", w("LightSource \"infinite\" \"rgb L\" [1 1 1] \"string filename\" \"map.exr\"")},
      {P, "has no parameter \"roughness\"", w("Material \"diffuse\" \"float roughness\" 1")},
      {P, "cannot read", w("Material \"diffuse\" \"string normalmap\" \"x.png\"")},
      {P, "\"pixelbounds\" is ignored", "Film \"rgb\" \"integer pixelbounds\" [0 4 0 4] \"float cropwindow\" [0 1 0 1]\n" + w("")},
      {P, "kelvin: ignored", "Film \"rgb\" \"float whitebalance\" 9\n" + w("")},
      {E, "sigma must be above 0", o("PixelFilter \"gaussian\" \"float sigma\" 0")},
      {E, "xresolution", o("Film \"rgb\" \"integer xresolution\" -5")},
      {E, "must be of type float", o("Film \"rgb\" \"string iso\" \"high\"")},
      {P, "taken for plain exposure", o("Film \"rgb\" \"string sensor\" \"canon_eos_5d\"")},
      {P, "film polaroid is unknown", o("Film \"polaroid\"")},
      {E, "is not supported; known are", o("Integrator \"magic\"")},
      {P, "is not square", w("LightSource \"infinite\" \"string filename\" \"good.ppm\"")},
      {P, "cannot be read", w("LightSource \"infinite\" \"string filename\" \"nowhere.exr\"")},
      {P, "", w("LightSource \"infinite\" \"point3 portal\" [0 0 0 1 0 0 1 1 0 0 1 0]")},
      {P, "portal is no rectangle", w("LightSource \"infinite\" \"point3 portal\" [0 0 0 1 0 0 2 1 0 0 1 0]")},
      {E, "portal must be four points, got 9 numbers", w("LightSource \"infinite\" \"point3 portal\" [0 0 0 1 0 0 2 1 0]")},
      {E, "portal has no area", w("LightSource \"infinite\" \"point3 portal\" [0 0 0 1 0 0 2 0 0 3 0 0]")},
      {E, "must be finite", w("AreaLightSource \"diffuse\" \"float power\" 1e40 Shape \"sphere\"")},
      {E, "needs a \"string filename\"", w("MakeNamedMedium \"m\" \"string type\" \"nanovdb\"")},
      {E, "cannot be opened", w("MakeNamedMedium \"m\" \"string type\" \"nanovdb\" \"string filename\" \"x.nvdb\"")},
      {E, "needs \"sigma_a\" or \"sigma_s\"", w("MakeNamedMedium \"m\" \"string type\" \"rgbgrid\"")},
      {E, "needs 3 values of \"sigma_s\"", w("MakeNamedMedium \"m\" \"string type\" \"rgbgrid\" \"rgb sigma_s\" [1 1 1 2 2 2]")},
      {E, "must have a volume", w("MakeNamedMedium \"m\" \"string type\" \"cloud\" \"point3 p1\" [0 1 1]")},
      {P, "unknown encoding", w(std::string("Texture \"x\" \"spectrum\" \"imagemap\" \"string filename\" \"good.png\" \"string encoding\" \"morse\"\nMaterial \"diffuse\" \"texture reflectance\" \"x\"\nShape \"trianglemesh\" ") + kTriangle)},
      {E, "dir must have a length", w(std::string("Texture \"x\" \"spectrum\" \"directionmix\" \"vector dir\" [0 0 0]\nMaterial \"diffuse\" \"texture reflectance\" \"x\"\nShape \"trianglemesh\" ") + kTriangle)},
      {P, "without \"string type\"", w("MakeNamedMaterial \"m\"")},
      {E, "must be of type string", w("MakeNamedMaterial \"m\" \"float type\" 1")},
  };
}

class BrokenScenes : public testing::Test {
 protected:
  BrokenScenes() {
    const auto head = [](const char* vertices, const char* faces) {
      return std::string("ply\nformat ascii 1.0\nelement vertex ") + vertices +
             "\nproperty float x\nproperty float y\nproperty float z\nelement face " + faces +
             "\nproperty list uchar int vertex_indices\nend_header\n";
    };
    const std::string points = "0 0 0\n1 0 0\n0 1 0\n", good = head("3", "1") + points + "3 0 1 2\n";
    write_file(folder_.path("empty.ply"), "");
    write_file(folder_.path("binary.ply"), std::string("\0\1\2\3\4\5\6\7", 8));
    write_file(folder_.path("short.ply"), head("3", "1") + "0 0 0\n1 0");
    write_file(folder_.path("huge.ply"), head("4000000000", "1") + points);
    write_file(folder_.path("index.ply"), head("3", "1") + points + "3 0 1 7\n");
    write_file(folder_.path("good.ply.gz"), gzip(good));
    write_file(folder_.path("cut.ply.gz"), gzip(good).substr(0, 40));
    write_file(folder_.path("broken.png"), "\x89PNG\r\n\x1a\nand no more");
    write_file(folder_.path("good.ppm"), "P6\n2 1\n255\n" + std::string(6, '\x7f'));
    std::vector<unsigned char> png;
    std::string why;
    EXPECT_TRUE(encode_bytes("good.png", 2, 1, std::vector<std::uint8_t>(6, 0x7f).data(), png, why)) << why;
    write_file(folder_.path("good.png"), std::string(png.begin(), png.end()));
    write_file(folder_.path("part.pbrt"), "ObjectInstance \"of nothing\"\n");
  }

  void check(const Broken& broken, Dialect dialect) {
    SCOPED_TRACE(broken.text.substr(0, 400));
    const std::string path = folder_.path("scene.pbrt");
    write_file(path, broken.text);
    const ReadScene scene = read_scene(path, folder_.path("split"), dialect);
    if (broken.end == End::error) {
      EXPECT_NE(scene.error.find(broken.says), std::string::npos) << scene.error;
      EXPECT_NE(scene.error.find("error: "), std::string::npos) << scene.error;
      // A place in the scene, or in the file that it names.
      EXPECT_NE(scene.error.find(folder_.path()), std::string::npos) << scene.error;
      return;
    }
    EXPECT_EQ(scene.error, "");
    EXPECT_TRUE(scene.warns(broken.says)) << scene.warnings;
    if (*broken.says == '\0') {
      EXPECT_EQ(scene.warnings, "");
    }
    JobOverrides small;
    small.width = small.height = 4;
    small.spp = 2;
    const RenderedScene picture = render_scene(path, dialect, small);
    EXPECT_EQ(picture.error, "");
    EXPECT_EQ(picture.pixels.size(), 48u);
    for (const float x : picture.pixels) EXPECT_TRUE(std::isfinite(x));
  }

  ~BrokenScenes() override {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    EXPECT_LT(usage.ru_maxrss, 1 << 20);  // KiB
  }

  const parts_test::TemporaryFolder folder_;
};

TEST_F(BrokenScenes, EndWithAnErrorAtItsPlaceOrAPicture) {
  for (const Broken& b : scenes()) check(b, Dialect::v2);
}

TEST_F(BrokenScenes, OfV4EndLikewise) {
  for (const Broken& b : scenes_of_v4()) check(b, Dialect::v4);
}

// Every parameter of every type with values of another type, with none and with too many: an error
// at the parameter, or nothing but warnings.
TEST_F(BrokenScenes, EveryParameterWithWrongValues) {
  std::size_t errors = 0, others = 0;
  for (const LanguageTable table : language_tables())
    for (const LanguageRow& row : table)
      for (const LanguageParam& p : language_params(row))
        for (const Dialect dialect : {Dialect::v2, Dialect::v3, Dialect::v4}) {
          if ((p.dialects & dialect_bit(dialect)) == 0) continue;
          for (const std::string& wrong :
               std::initializer_list<std::string>{" \"string " + std::string(p.name) + "\" \"17\"",
                " \"float " + std::string(p.name) + "\" []",
                " \"integer " + std::string(p.name) + "\" [2000000000 -5 0 1 2 3 4 5 6]",
                " \"bool " + std::string(p.name) + "\" \"true\"",
                " \"point " + std::string(p.name) + "\" [1e30 -1e30 0]",
                " \"texture " + std::string(p.name) + "\" \"nothing\""}) {
            const std::string directive(row.directive), own = directive + " \"" + std::string(row.type) + "\"" + wrong;
            const bool in_world = row.directive == "Shape" || row.directive == "Material" ||
                                  row.directive == "LightSource" || row.directive == "AreaLightSource" ||
                                  row.directive == "Volume";
            std::string text;
            if (row.directive == "Texture")
              text = "WorldBegin\nTexture \"x\" \"spectrum\" \"" + std::string(row.type) + "\"" + wrong +
                     "\nMaterial \"" + (dialect == Dialect::v4 ? "diffuse\" \"texture reflectance" : "matte\" \"texture Kd") +
                     "\" \"x\"\nShape \"sphere\"\n";
            else if (in_world)
              text = "WorldBegin\n" + own + "\nShape \"sphere\"\n";
            else if (row.directive == "MakeNamedMedium")
              text = "WorldBegin\nMakeNamedMedium \"m\" \"string type\" \"" + std::string(row.type) + "\"" + wrong;
            else
              text = own + "\nWorldBegin\n";
            SCOPED_TRACE(text);
            write_file(folder_.path("scene.pbrt"), text);
            const ReadScene scene = read_text(folder_.path("scene.pbrt"), dialect);
            if (scene.error.empty()) {
              ++others;
              continue;
            }
            ++errors;
            EXPECT_EQ(scene.error.find(folder_.path("scene.pbrt:")), 0u) << scene.error;
            EXPECT_NE(scene.error.find("error: "), std::string::npos) << scene.error;
          }
        }
  EXPECT_GT(errors, 500u);
  EXPECT_GT(others, 500u);
}

}  // namespace
}  // namespace cloudrenderer
