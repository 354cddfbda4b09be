// The API's page names what there is, no more and no less.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "service/api.h"

namespace cloudrenderer {
namespace {

const Json& page() {
  static const Json kPage = Json::parse(kOpenApi);
  return kPage;
}

TEST(OpenApi, HasEveryRouteAndNoOther) {
  std::set<std::string> told, there;
  for (const auto& [path, item] : page().at("paths").items())
    for (const auto& [method, operation] : item.items())
      if (method != "parameters") {
        std::string upper = method;
        std::ranges::transform(upper, upper.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
        told.insert(upper + " " + path);
      }
  for (const std::string& route : Api::routes()) there.insert(route);
  EXPECT_EQ(told, there);
}

void find_references(const Json& json, std::set<std::string>& out) {
  if (json.is_object() && json.contains("$ref")) out.insert(json.at("$ref").get<std::string>());
  if (json.is_structured())
    for (const auto& [key, value] : json.items()) find_references(value, out);
}

TEST(OpenApi, ReferencesLeadSomewhere) {
  std::set<std::string> references;
  find_references(page(), references);
  EXPECT_GE(references.size(), 10u);
  for (const std::string& r : references) EXPECT_TRUE(page().contains(Json::json_pointer(r.substr(1)))) << r;
}

TEST(OpenApi, SchemasHaveTheKeysOfWhatIsSent) {
  Job job;
  job.frames.emplace_back();
  const auto keys_of = [](const Json& json) {
    std::set<std::string> out;
    for (const auto& [key, value] : json.items()) out.insert(key);
    return out;
  };
  const Json& schemas = page().at("components").at("schemas");
  const Json sent = to_json(job);
  EXPECT_EQ(keys_of(schemas.at("Job").at("properties")), keys_of(sent));
  EXPECT_EQ(keys_of(schemas.at("Frame").at("properties")), keys_of(sent.at("frames")[0]));
  EXPECT_EQ(keys_of(schemas.at("Usage").at("properties")), keys_of(sent.at("usage")));
  JobRequest request;
  EXPECT_EQ(keys_of(schemas.at("JobRequest").at("properties")), keys_of(to_json(request)));
}

}  // namespace
}  // namespace cloudrenderer
