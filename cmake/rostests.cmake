# SPDX-License-Identifier: BSD-3-Clause
#
# The rostests: the nodelets in a real manager. Recordings that they replay are simulated when tests are built.

set(devo_test_data ${CMAKE_CURRENT_BINARY_DIR}/test_data)
file(MAKE_DIRECTORY ${devo_test_data})
set(devo_sample ${devo_test_data}/sample)
add_custom_command(
  OUTPUT ${devo_sample}.bag ${devo_sample}.yaml ${devo_sample}_groundtruth.txt
  COMMAND devo_simulate --out ${devo_sample} --scene table --sensor davis346 --speed slow --duration 2 --depth kinect
          --depth-rate 20 --seed 1 --no-frames --quiet
  DEPENDS devo_simulate
  COMMENT "Simulating a recording for the rostests"
  VERBATIM)
add_custom_target(devo_sample_recording DEPENDS ${devo_sample}.bag)

file(MAKE_DIRECTORY ${devo_test_data}/mvsec ${devo_test_data}/vector)
set(devo_mvsec ${devo_test_data}/mvsec/indoor_flying1)
add_custom_command(
  OUTPUT ${devo_mvsec}_data.bag ${devo_mvsec}_gt.bag
  COMMAND devo_simulate --out ${devo_mvsec} --dialect mvsec --scene table --sensor davis346 --speed slow --duration 2
          --depth registered --depth-rate 20 --no-frames --quiet
  DEPENDS devo_simulate
  COMMENT "Simulating a recording in MVSEC's dialect"
  VERBATIM)
set(devo_vector ${devo_test_data}/vector/desk_normal1)
add_custom_command(
  OUTPUT ${devo_vector}.synced.left_event.bag ${devo_vector}.synced.kinect_depth.bag ${devo_vector}.synced.gt.bag
         ${devo_vector}.synced.imu.bag
  COMMAND devo_simulate --out ${devo_vector} --dialect vector --scene table --sensor davis346 --speed slow --duration 2
          --depth kinect --depth-rate 20 --no-frames --quiet
  DEPENDS devo_simulate
  COMMENT "Simulating a recording in VECtor's dialect"
  VERBATIM)
add_custom_target(devo_dialect_recordings
  DEPENDS ${devo_mvsec}_data.bag ${devo_vector}.synced.left_event.bag)

set(devo_rostest_dependencies devo_nodelets devo_node devo_offline devo_evaluate devo_sample_recording)

add_rostest(test/rostest/replay.test
  ARGS bag:=${devo_sample}.bag config:=${devo_sample}.yaml
  DEPENDENCIES ${devo_rostest_dependencies})

add_rostest(test/rostest/lifecycle.test
  ARGS bag:=${devo_sample}.bag config:=${devo_sample}.yaml
  DEPENDENCIES ${devo_rostest_dependencies})

add_rostest(test/rostest/burst.test
  ARGS bag:=${devo_sample}.bag config:=${devo_sample}.yaml
  DEPENDENCIES ${devo_rostest_dependencies})

add_rostest(test/rostest/bad_parameters.test DEPENDENCIES ${devo_rostest_dependencies})

add_rostest_gmock(due_surface_test test/rostest/due_surface.test test/rostest/due_surface_test.cpp)
target_link_libraries(due_surface_test devo_ros)
add_dependencies(due_surface_test devo_nodelets)

add_rostest_gmock(zero_copy_test test/rostest/zero_copy.test test/rostest/zero_copy_test.cpp)
target_link_libraries(zero_copy_test devo_ros devo_sim)
devo_use_event_messages(zero_copy_test test/rostest/zero_copy_test.cpp)
add_dependencies(zero_copy_test devo_nodelets)

add_rostest(test/rostest/live.test
  ARGS bag:=${devo_sample}.bag config:=${devo_sample}.yaml
  DEPENDENCIES ${devo_rostest_dependencies})

add_rostest(test/rostest/launch_files.test)

add_rostest(test/rostest/simulated_sensor.test DEPENDENCIES devo_nodelets)
add_rostest(test/rostest/install.test
  ARGS build:=${CMAKE_CURRENT_BINARY_DIR} bag:=${devo_sample}.bag config:=${devo_sample}.yaml
  DEPENDENCIES ${devo_rostest_dependencies})

add_rostest(test/rostest/recordings.test
  ARGS mvsec:=${devo_test_data}/mvsec vector:=${devo_test_data}/vector
  DEPENDENCIES ${devo_rostest_dependencies} devo_dialect_recordings)

add_rostest(test/rostest/rviz.test
  ARGS bag:=${devo_sample}.bag config:=${devo_sample}.yaml
  DEPENDENCIES ${devo_rostest_dependencies})
