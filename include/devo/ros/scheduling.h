// SPDX-License-Identifier: BSD-3-Clause
//
// What the calling thread asks of the system's scheduler, without any privilege. Elsewhere than on Linux, nothing.
#pragma once

namespace devo {

/// To run soon after it was woken, in turns that are short: its share of the processor stays that of the others. Linux
/// 6.12 and later take a thread of long turns off the processor for it; earlier ones ignore this.
void PreferShortWaits();

/// To be served after others where not all can be served at once: with a third of their share of a processor.
void LetOthersFirst();

}  // namespace devo
