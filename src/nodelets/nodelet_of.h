// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <memory>

#include <nodelet/nodelet.h>

namespace devo {

/// A nodelet that constructs one of the ROS classes. What the class refuses stops this nodelet, not its manager.
template <typename Node>
class NodeletOf : public nodelet::Nodelet {
 private:
  void onInit() override {
    try {
      node_ = std::make_unique<Node>(getNodeHandle(), getPrivateNodeHandle());
    } catch (const std::exception& error) {
      NODELET_FATAL_STREAM(getName() << " does not run: " << error.what());
    }
  }

  std::unique_ptr<Node> node_;
};

}  // namespace devo
