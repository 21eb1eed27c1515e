// SPDX-License-Identifier: BSD-3-Clause
#include "urdf_origin.h"

#include <cmath>
#include <stdexcept>

#include <interactive_mapping_common/formatted.h>

namespace mp700_ur5e_description {

std::string toDigits(const Eigen::VectorXd& values, const char* separator) {
  std::string text;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    // Adding zero turns -0 into 0.
    text +=
        (i == 0 ? "" : separator) + interactive_mapping::formatted("%.10f", std::round(values[i] * 1e10) * 1e-10 + 0.0);
  }
  return text;
}

tinyxml2::XMLElement* parseUrdf(const std::string& urdf, tinyxml2::XMLDocument* document) {
  if (document->Parse(urdf.data(), urdf.size()) != tinyxml2::XML_SUCCESS) {
    throw std::invalid_argument(std::string("the URDF is not XML: ") + document->ErrorStr());
  }
  tinyxml2::XMLElement* robot = document->FirstChildElement("robot");
  if (robot == nullptr) throw std::invalid_argument("the URDF must have a <robot>");
  return robot;
}

void setOrigin(tinyxml2::XMLElement* joint, const Eigen::Vector3d& xyz_m, const Eigen::Vector3d& rpy_rad) {
  tinyxml2::XMLElement* origin = joint->FirstChildElement("origin");
  if (origin == nullptr) {
    origin = joint->GetDocument()->NewElement("origin");
    joint->InsertEndChild(origin);
  }
  origin->SetAttribute("xyz", toDigits(xyz_m, " ").c_str());
  origin->SetAttribute("rpy", toDigits(rpy_rad, " ").c_str());
}

std::string toText(const tinyxml2::XMLDocument& document) {
  tinyxml2::XMLPrinter printer;
  document.Print(&printer);
  return printer.CStr();
}

}  // namespace mp700_ur5e_description
