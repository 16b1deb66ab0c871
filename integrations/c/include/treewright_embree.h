/* Embree 4 for Treewright: what can be tuned about Embree's own trees, and how a configuration is applied.
 *
 * Header only, C99 and C++, and nothing of it is in libtreewright, so that the library does not need Embree. Two ways lead
 * to an Embree tree, and each has a pair of functions:
 *
 *   scenes (rtcCommitScene)     tw_embree_scene_parameters   tw_embree_device_string, tw_embree_scene_flags, tw_embree_quality
 *   own trees (rtcBuildBVH)     tw_embree_build_parameters   tw_embree_build_arguments
 *
 * What may be offered was found by trying it with Embree 4.4.0: named accelerations act with quality medium alone, and a
 * builder with spatial splits gives wrong hits with bvh8.triangle4v. `robust` decides which hits are found at edges, so it is
 * the program's question and not the stopwatch's; with it or with compact scenes, quality high is medium.
 */
#ifndef TREEWRIGHT_EMBREE_H
#define TREEWRIGHT_EMBREE_H

#include <embree4/rtcore.h>
#include <stdio.h>
#include <string.h>

#include "treewright.h"

/* Adds quality (low, medium, high) and layout (auto, compact, or nodes and leaves by name) to a study.
 * robust: the scenes have RTC_SCENE_FLAG_ROBUST, so that only watertight leaves are offered. */
static inline void tw_embree_scene_parameters(tw_spec *spec, bool robust) {
  static const char *const qualities[] = {"low", "medium", "high"};
  static const char *const robust_layouts[] = {"auto", "compact", "bvh4.triangle4v", "bvh8.triangle4v"};
  static const char *const layouts[] = {"auto", "compact", "bvh4.triangle4", "bvh8.triangle4i", "qbvh8.triangle4"};
  tw_spec_choice(spec, "quality", qualities, robust ? 2 : 3, "medium");
  if (robust)
    tw_spec_choice(spec, "layout", robust_layouts, 4, "auto");
  else
    tw_spec_choice(spec, "layout", layouts, 5, "auto");
  tw_spec_active_if(spec, "quality", "medium");
}

/* Text of a parameter, or another where it does not act. */
static inline const char *tw_embree_text(const tw_configuration *configuration, const char *name, const char *otherwise) {
  const char *text = tw_configuration_has(configuration, name) ? tw_configuration_text(configuration, name, NULL) : NULL;
  return text ? text : otherwise;
}

/* Writes the configuration for rtcNewDevice into text; own, which may be NULL, is put before it. A layout by name needs a device of
 * its own, so keep devices by this text. Returns false when there is no room: 64 bytes suffice without an own part. */
static inline bool tw_embree_device_string(const tw_configuration *configuration, const char *own, char *text, size_t room) {
  const char *layout = tw_embree_text(configuration, "layout", "auto");
  bool named = strcmp(layout, "auto") != 0 && strcmp(layout, "compact") != 0;
  const char *between = own && own[0] && named ? "," : "";
  int written = snprintf(text, room, "%s%s%s%s", own ? own : "", between, named ? "tri_accel=" : "", named ? layout : "");
  return written >= 0 && (size_t)written < room;
}

/* The flags for rtcSetSceneFlags: the program's own, and compact where that is chosen. */
static inline enum RTCSceneFlags tw_embree_scene_flags(const tw_configuration *configuration, enum RTCSceneFlags own) {
  bool compact = strcmp(tw_embree_text(configuration, "layout", "auto"), "compact") == 0;
  return (enum RTCSceneFlags)((int)own | (compact ? (int)RTC_SCENE_FLAG_COMPACT : 0));
}

/* The quality for rtcSetSceneBuildQuality and rtcBuildBVH. */
static inline enum RTCBuildQuality tw_embree_quality(const tw_configuration *configuration) {
  const char *quality = tw_embree_text(configuration, "quality", "medium");
  if (strcmp(quality, "low") == 0) return RTC_BUILD_QUALITY_LOW;
  return strcmp(quality, "high") == 0 ? RTC_BUILD_QUALITY_HIGH : RTC_BUILD_QUALITY_MEDIUM;
}

/* Adds the arguments of rtcBuildBVH (paper Table 1) to a study, with Embree's own defaults. widest: children of the program's widest
 * node, at least 2. splits: the program has a splitPrimitive function and room for copies, so that quality high may be asked for. */
static inline void tw_embree_build_parameters(tw_spec *spec, unsigned widest, bool splits) {
  static const char *const qualities[] = {"low", "medium", "high"};
  tw_spec_choice(spec, "quality", qualities, splits ? 3 : 2, "medium");
  if (widest > 2) tw_spec_integer(spec, "max_branching_factor", 2, widest, 2, TW_LINEAR);
  tw_spec_integer(spec, "max_depth", 24, 64, 32, TW_LINEAR);
  tw_spec_integer(spec, "sah_block_size", 1, 16, 1, TW_LOG);
  tw_spec_integer(spec, "min_leaf_size", 1, 16, 1, TW_LOG);
  tw_spec_integer(spec, "max_leaf_size", 1, 32, 32, TW_LOG);
  tw_spec_float(spec, "traversal_cost", 0.125, 8, 1, TW_LOG); /* in tests of a triangle */
  tw_spec_less_or_equal(spec, "min_leaf_size", "max_leaf_size");
}

/* Sets those members of the arguments that the configuration has values for; the rest stays as it is. */
static inline void tw_embree_build_arguments(const tw_configuration *configuration, struct RTCBuildArguments *arguments) {
  struct {
    const char *name;
    unsigned *member;
  } whole[] = {{"max_branching_factor", &arguments->maxBranchingFactor},
               {"max_depth", &arguments->maxDepth},
               {"sah_block_size", &arguments->sahBlockSize},
               {"min_leaf_size", &arguments->minLeafSize},
               {"max_leaf_size", &arguments->maxLeafSize}};
  int64_t value;
  double cost;
  size_t each;
  for (each = 0; each < sizeof whole / sizeof whole[0]; each++)
    if (tw_configuration_has(configuration, whole[each].name) &&
        tw_configuration_integer(configuration, whole[each].name, &value, NULL))
      *whole[each].member = (unsigned)value;
  if (tw_configuration_has(configuration, "traversal_cost") &&
      tw_configuration_float(configuration, "traversal_cost", &cost, NULL))
    arguments->traversalCost = (float)cost * arguments->intersectionCost;
  if (tw_configuration_has(configuration, "quality")) arguments->buildQuality = tw_embree_quality(configuration);
}

#endif
