// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace devo {

/// Stamps that fall by more than this many seconds are those of a bag that is played again, or of a clock that was set
/// back: for events and all that is compared with them alike.
constexpr double kPlayedAgain_s = 0.1;

}  // namespace devo
