// SPDX-License-Identifier: BSD-3-Clause
//
// The types in which events come: this package's own, and those of the drivers' packages that were found when the
// including source was configured (devo_use_event_messages in CMakeLists.txt).
#pragma once

#include "devo/EventArray.h"
#include "devo/EventPacket.h"
#ifdef DEVO_WITH_DVS_MSGS
#include <dvs_msgs/EventArray.h>
#endif
#ifdef DEVO_WITH_PROPHESEE_EVENT_MSGS
#include <prophesee_event_msgs/EventArray.h>
#endif
#ifdef DEVO_WITH_EVENT_CAMERA_MSGS
#include <event_camera_msgs/EventPacket.h>
#endif

namespace devo {

template <typename... Messages>
struct MessageTypes {};

/// EventArray and EventPacket of this package are the first two.
using EventMessageTypes = MessageTypes<EventArray, EventPacket
#ifdef DEVO_WITH_DVS_MSGS
                                       ,
                                       dvs_msgs::EventArray
#endif
#ifdef DEVO_WITH_PROPHESEE_EVENT_MSGS
                                       ,
                                       prophesee_event_msgs::EventArray
#endif
#ifdef DEVO_WITH_EVENT_CAMERA_MSGS
                                       ,
                                       event_camera_msgs::EventPacket
#endif
                                       >;

}  // namespace devo
