// Treewright's client SDK for C++17: the handles of treewright.h as objects that free themselves, and errors as exceptions.
//
// Header only. Objects move and do not copy. The comments of treewright.h hold for threads and waiting; every function that fails
// there throws tw::Error here.
#ifndef TREEWRIGHT_HPP
#define TREEWRIGHT_HPP

#include <cmath>
#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "treewright.h"

namespace tw {

// An error: what() names cause and remedy.
class Error : public std::runtime_error {
 public:
  Error(int32_t code, int32_t grpc_code, const char *message)
      : std::runtime_error(message), code(code), grpc_code(grpc_code) {}
  const int32_t code;       // one of enum tw_code
  const int32_t grpc_code;  // of a refusal, else 0
};

namespace detail {

struct Free {
  void operator()(tw_error *it) const { tw_error_free(it); }
  void operator()(tw_options *it) const { tw_options_free(it); }
  void operator()(tw_client *it) const { tw_client_free(it); }
  void operator()(tw_spec *it) const { tw_spec_free(it); }
  void operator()(tw_study *it) const { tw_study_free(it); }
  void operator()(tw_tuner *it) const { tw_tuner_free(it); }
  void operator()(tw_front *it) const { tw_front_free(it); }
  void operator()(tw_front_runs *it) const { tw_front_runs_free(it); }
  void operator()(tw_front_run *it) const { tw_front_run_free(it); }
  void operator()(tw_suggestion *it) const { tw_suggestion_free(it); }
  void operator()(tw_configuration *it) const { tw_configuration_free(it); }
  void operator()(tw_scene *it) const { tw_scene_free(it); }
};

template <typename Handle>
using Owned = std::unique_ptr<Handle, Free>;

// Calls a function of C with room for its error, and throws what it leaves there.
template <typename Call>
auto checked(Call call) {
  tw_error *raw = nullptr;
  auto result = call(&raw);
  if (Owned<tw_error> error{raw}) throw Error(tw_error_code(raw), tw_error_grpc_code(raw), tw_error_message(raw));
  return result;
}

}  // namespace detail

// Indicators or measurements. The names are not copied: literals do.
using Numbers = std::vector<tw_number>;

// A configuration that belongs to something else.
class ConfigurationView {
 public:
  explicit ConfigurationView(const tw_configuration *handle) : handle_(handle) {}
  int64_t integer(const char *name) const {
    int64_t value = 0;
    detail::checked([&](tw_error **error) { return tw_configuration_integer(handle_, name, &value, error); });
    return value;
  }
  double number(const char *name) const {
    double value = 0;
    detail::checked([&](tw_error **error) { return tw_configuration_float(handle_, name, &value, error); });
    return value;
  }
  bool boolean(const char *name) const {
    bool value = false;
    detail::checked([&](tw_error **error) { return tw_configuration_boolean(handle_, name, &value, error); });
    return value;
  }
  std::string text(const char *name) const {
    return detail::checked([&](tw_error **error) { return tw_configuration_text(handle_, name, error); });
  }
  bool has(const char *name) const { return tw_configuration_has(handle_, name); }
  std::string json() const { return tw_configuration_json(handle_); }
  const tw_configuration *handle() const { return handle_; }

 private:
  const tw_configuration *handle_;
};

// A configuration with the objective that is known or predicted of it.
class Known {
 public:
  Known(tw_configuration *handle, double cost, const tw_standing &standing = nothing_known())
      : cost(cost), standing(standing), owned_(handle) {}
  ConfigurationView configuration() const { return ConfigurationView(owned_.get()); }
  // Of Study::predict: whether it was measured for such an input or is only predicted.
  std::string reason() const { return tw_configuration_reason(owned_.get()); }
  double cost;  // NaN where nothing is known
  // Of Study::best: what is proven, with its intervals; its texts live as long as this. Of others nothing is known.
  tw_standing standing;
  static tw_standing nothing_known() {
    return {NAN, NAN, NAN, NAN, NAN, NAN, NAN, TW_STAGE_UNKNOWN, false, NAN, 0, "", "", ""};
  }

 private:
  detail::Owned<tw_configuration> owned_;
};

// Reads the JSON of a configuration.
inline Known parse(const std::string &json) {
  return Known(detail::checked([&](tw_error **error) { return tw_configuration_new(json.c_str(), error); }), NAN);
}

// The next configuration to run. Report it, or let it go, which gives the trial back.
class Suggestion {
 public:
  explicit Suggestion(tw_suggestion *handle) : owned_(handle) {}
  ConfigurationView configuration() const { return ConfigurationView(tw_suggestion_configuration(owned_.get())); }
  tw_source source() const { return static_cast<tw_source>(tw_suggestion_source(owned_.get())); }
  std::string trial() const { return tw_suggestion_trial(owned_.get()); }
  std::string reason() const { return tw_suggestion_reason(owned_.get()); }
  std::string problem() const {
    const char *problem = tw_suggestion_problem(owned_.get());
    return problem ? problem : "";
  }
  double predicted_cost() const { return tw_suggestion_predicted_cost(owned_.get()); }
  double abort_above() const { return tw_suggestion_abort_above(owned_.get()); }
  // Empty for a full trial.
  std::string fidelity() const {
    const char *level = tw_suggestion_fidelity(owned_.get());
    return level ? level : "";
  }
  bool is_prepared() const { return tw_suggestion_is_prepared(owned_.get()); }
  // Of measurements that are estimates, before it is reported or finished: poor ones count for less.
  void standard_errors(const Numbers &errors) {
    detail::checked([&](tw_error **error) {
      return tw_suggestion_standard_errors(owned_.get(), errors.data(), errors.size(), error);
    });
  }
  // Each of these ends it.
  void report(const Numbers &measurements) {
    end([&](tw_suggestion *it, tw_error **error) {
      return tw_suggestion_report(it, measurements.data(), measurements.size(), error);
    });
  }
  void aborted(double lower_bound) {
    end([&](tw_suggestion *it, tw_error **error) { return tw_suggestion_aborted(it, lower_bound, error); });
  }
  void infeasible(const std::string &reason) {
    end([&](tw_suggestion *it, tw_error **error) { return tw_suggestion_infeasible(it, reason.c_str(), error); });
  }
  void failed(const std::string &reason) {
    end([&](tw_suggestion *it, tw_error **error) { return tw_suggestion_failed(it, reason.c_str(), error); });
  }
  tw_suggestion *handle() const { return owned_.get(); }
  tw_suggestion *release() { return owned_.release(); }

 private:
  template <typename Call>
  void end(Call call) {
    detail::checked([&](tw_error **error) { return call(owned_.release(), error); });
  }
  detail::Owned<tw_suggestion> owned_;
};

// A frame loop: one round trip a frame.
class Tuner {
 public:
  explicit Tuner(tw_tuner *handle) : owned_(handle) {}
  Suggestion next(const Numbers &indicators) {
    return Suggestion(detail::checked([&](tw_error **error) {
      return tw_tuner_next(owned_.get(), indicators.data(), indicators.size(), error);
    }));
  }
  void finish(Suggestion &&suggestion, const Numbers &measurements) {
    detail::checked([&](tw_error **error) {
      return tw_tuner_finish(owned_.get(), suggestion.release(), measurements.data(), measurements.size(), error);
    });
  }

 private:
  detail::Owned<tw_tuner> owned_;
};

// A run of a front. Report it, or let it go, which gives the trial back.
class FrontRun {
 public:
  explicit FrontRun(tw_front_run *handle) : owned_(handle) {}
  // False where no run is left.
  explicit operator bool() const { return owned_ != nullptr; }
  ConfigurationView configuration() const { return ConfigurationView(tw_front_run_configuration(owned_.get())); }
  std::string trial() const { return tw_front_run_trial(owned_.get()); }
  // Each of these ends it; where one throws, FrontRuns::suggest gives the same run again.
  void report(const Numbers &measurements) {
    end([&](tw_front_run *it, tw_error **error) {
      return tw_front_run_report(it, measurements.data(), measurements.size(), error);
    });
  }
  void infeasible(const std::string &reason) {
    end([&](tw_front_run *it, tw_error **error) { return tw_front_run_infeasible(it, reason.c_str(), error); });
  }
  void failed(const std::string &reason) {
    end([&](tw_front_run *it, tw_error **error) { return tw_front_run_failed(it, reason.c_str(), error); });
  }

 private:
  template <typename Call>
  void end(Call call) {
    detail::checked([&](tw_error **error) { return call(owned_.release(), error); });
  }
  detail::Owned<tw_front_run> owned_;
};

// Looks for a Pareto front: while (FrontRun run = runs.suggest()) run.report(measure(run.configuration()));
class FrontRuns {
 public:
  explicit FrontRuns(tw_front_runs *handle) : owned_(handle) {}
  FrontRun suggest() const {
    return FrontRun(detail::checked([&](tw_error **error) { return tw_front_runs_suggest(owned_.get(), error); }));
  }
  // The JSON of the front so far, as Study::front gives it.
  std::string found() const {
    detail::Owned<tw_front> found(
        detail::checked([&](tw_error **error) { return tw_front_runs_found(owned_.get(), error); }));
    return tw_front_json(found.get());
  }

 private:
  detail::Owned<tw_front_runs> owned_;
};

class Study {
 public:
  explicit Study(tw_study *handle) : owned_(handle) {}
  Suggestion suggest(const Numbers &indicators = {}) const {
    return Suggestion(detail::checked([&](tw_error **error) {
      return tw_study_suggest(owned_.get(), indicators.data(), indicators.size(), error);
    }));
  }
  Suggestion trial_of(const Numbers &indicators, const std::string &configuration_json) const {
    return Suggestion(detail::checked([&](tw_error **error) {
      return tw_study_trial_of(owned_.get(), indicators.data(), indicators.size(), configuration_json.c_str(), error);
    }));
  }
  // What the program runs by default, with all its values; nullptr for the study's default.
  void set_start(const char *configuration_json) const {
    detail::checked([&](tw_error **error) { return tw_study_set_start(owned_.get(), configuration_json, error); });
  }
  Known predict(const Numbers &indicators = {}) const {
    double cost = 0;
    tw_configuration *found = detail::checked([&](tw_error **error) {
      return tw_study_predict(owned_.get(), indicators.data(), indicators.size(), &cost, error);
    });
    return Known(found, cost);
  }
  Known best(const Numbers &indicators = {}) const {
    double cost = 0;
    tw_standing standing = Known::nothing_known();
    tw_configuration *found = detail::checked([&](tw_error **error) {
      return tw_study_best_standing(owned_.get(), indicators.data(), indicators.size(), &cost, &standing, error);
    });
    return Known(found, cost, standing);
  }
  double value(double cost) const { return tw_study_value(owned_.get(), cost); }
  // The JSON of the Pareto front of the stored trials; without metrics of those that the study was made for.
  std::string front(const std::vector<const char *> &metrics = {}, int64_t state = 0) const {
    detail::Owned<tw_front> found(detail::checked([&](tw_error **error) {
      return tw_study_front(owned_.get(), metrics.data(), metrics.size(), state, error);
    }));
    return tw_front_json(found.get());
  }
  Tuner tuner() const {
    return Tuner(detail::checked([&](tw_error **error) { return tw_tuner_new(owned_.get(), error); }));
  }

 private:
  detail::Owned<tw_study> owned_;
};

// The definition of a study. Client::study reports mistakes.
class Spec {
 public:
  Spec() : owned_(tw_spec_new()) {}
  Spec &integer(const char *name, int64_t min, int64_t max, int64_t initial, tw_scale scale = TW_LINEAR) {
    return tw_spec_integer(handle(), name, min, max, initial, scale), *this;
  }
  Spec &number(const char *name, double min, double max, double initial, tw_scale scale = TW_LINEAR) {
    return tw_spec_float(handle(), name, min, max, initial, scale), *this;
  }
  Spec &boolean(const char *name, bool initial) { return tw_spec_boolean(handle(), name, initial), *this; }
  Spec &choice(const char *name, std::initializer_list<const char *> values, const char *initial) {
    return tw_spec_choice(handle(), name, values.begin(), values.size(), initial), *this;
  }
  Spec &choice_number(const char *name, std::initializer_list<double> values, double initial) {
    return tw_spec_choice_number(handle(), name, values.begin(), values.size(), initial), *this;
  }
  Spec &choice_integer(const char *name, std::initializer_list<int64_t> values, int64_t initial) {
    return tw_spec_choice_integer(handle(), name, values.begin(), values.size(), initial), *this;
  }
  Spec &active_if(const char *parameter, const char *value) {
    return tw_spec_active_if(handle(), parameter, value), *this;
  }
  Spec &setup() { return tw_spec_setup(handle()), *this; }
  Spec &less_or_equal(const char *lesser, const char *greater) {
    return tw_spec_less_or_equal(handle(), lesser, greater), *this;
  }
  Spec &step(int64_t step) { return tw_spec_step(handle(), step), *this; }
  Spec &constraint(const char *expression) { return tw_spec_constraint(handle(), expression), *this; }
  Spec &indicator(const char *name, double min, double max, tw_scale scale = TW_LINEAR) {
    return tw_spec_indicator(handle(), name, min, max, scale), *this;
  }
  Spec &scene_indicators() { return tw_spec_scene_indicators(handle()), *this; }
  Spec &minimise(const char *metric, double weight = 1) { return tw_spec_minimise(handle(), metric, weight), *this; }
  Spec &maximise(const char *metric, double weight = 1) { return tw_spec_maximise(handle(), metric, weight), *this; }
  Spec &auxiliary(const char *metric) { return tw_spec_auxiliary(handle(), metric), *this; }
  Spec &limit(const char *metric, double at_least, double at_most) {
    return tw_spec_limit(handle(), metric, at_least, at_most), *this;
  }
  Spec &episode_frames(uint32_t frames) { return tw_spec_episode_frames(handle(), frames), *this; }
  Spec &fidelity(const char *name, double cost) { return tw_spec_fidelity(handle(), name, cost), *this; }
  Spec &policy(const char *field, const char *value) { return tw_spec_policy(handle(), field, value), *this; }
  Spec &state_tolerance(double tolerance) { return tw_spec_state_tolerance(handle(), tolerance), *this; }
  Spec &seed(uint64_t seed) { return tw_spec_seed(handle(), seed), *this; }
  Spec &display_name(const char *text) { return tw_spec_display_name(handle(), text), *this; }
  tw_spec *handle() const { return owned_.get(); }

 private:
  detail::Owned<tw_spec> owned_;
};

// Options of a client. Client reports mistakes.
class Options {
 public:
  Options() : owned_(tw_options_new()) {}
  Options &client_id(const std::string &id) { return tw_options_client_id(handle(), id.c_str()), *this; }
  Options &deadline_ms(double ms) { return tw_options_deadline_ms(handle(), ms), *this; }
  Options &call_deadline_ms(double ms) { return tw_options_call_deadline_ms(handle(), ms), *this; }
  Options &queue(size_t reports) { return tw_options_queue(handle(), reports), *this; }
  Options &can_abort(bool can) { return tw_options_can_abort(handle(), can), *this; }
  Options &fidelities(bool knows) { return tw_options_fidelities(handle(), knows), *this; }
  Options &software(const char *name, const char *version) {
    return tw_options_software(handle(), name, version), *this;
  }
  Options &token(const std::string &token) { return tw_options_token(handle(), token.c_str()), *this; }
  Options &token_file(const std::string &path) { return tw_options_token_file(handle(), path.c_str()), *this; }
  Options &authority_file(const std::string &path) { return tw_options_authority_file(handle(), path.c_str()), *this; }
  Options &certificate_files(const std::string &certificate, const std::string &key) {
    return tw_options_certificate_files(handle(), certificate.c_str(), key.c_str()), *this;
  }
  tw_options *handle() const { return owned_.get(); }

 private:
  detail::Owned<tw_options> owned_;
};

class Client {
 public:
  explicit Client(const std::string &url, const Options &options = {})
      : owned_(detail::checked(
            [&](tw_error **error) { return tw_client_connect(url.c_str(), options.handle(), error); })) {}
  Study study(const std::string &id, const Spec &spec) const {
    return Study(detail::checked(
        [&](tw_error **error) { return tw_client_study(owned_.get(), id.c_str(), spec.handle(), error); }));
  }
  Study existing_study(const std::string &id) const {
    return Study(detail::checked(
        [&](tw_error **error) { return tw_client_existing_study(owned_.get(), id.c_str(), error); }));
  }
  // Metrics as "time_ms" and "1/rate"; the specification has none of its own.
  FrontRuns front_runs(const std::string &id, const Spec &spec, const std::vector<const char *> &metrics,
                       uint32_t planned = 80) const {
    return FrontRuns(detail::checked([&](tw_error **error) {
      return tw_client_front_runs(owned_.get(), id.c_str(), spec.handle(), metrics.data(), metrics.size(), planned, error);
    }));
  }
  void delete_study(const std::string &id) const {
    detail::checked([&](tw_error **error) { return tw_client_delete_study(owned_.get(), id.c_str(), error); });
  }
  // With an empty text for no fixed values.
  tw_changed_space change_space(const std::string &id, const Spec &spec, const std::string &fixed_json = "",
                                bool only_try = false) const {
    tw_changed_space changed{};
    const char *fixed = fixed_json.empty() ? nullptr : fixed_json.c_str();
    detail::checked([&](tw_error **error) {
      return tw_client_change_space(owned_.get(), id.c_str(), spec.handle(), fixed, only_try, &changed, error);
    });
    return changed;
  }
  void extend_lease(Suggestion &suggestion) const {
    detail::checked([&](tw_error **error) { return tw_client_extend_lease(owned_.get(), suggestion.handle(), error); });
  }
  void flush(double deadline_ms) const {
    detail::checked([&](tw_error **error) { return tw_client_flush(owned_.get(), deadline_ms, error); });
  }
  double ping_ms() const {
    double ms = 0;
    detail::checked([&](tw_error **error) { return tw_client_ping(owned_.get(), &ms, error); });
    return ms;
  }
  uint64_t count(tw_count which) const { return tw_client_count(owned_.get(), which); }

 private:
  detail::Owned<tw_client> owned_;
};

// The seventeen indicators of a scene; the buffers are read by the constructor alone.
class Scene {
 public:
  explicit Scene(const std::vector<tw_mesh> &meshes, uint32_t other_lights = 0)
      : owned_(detail::checked([&](tw_error **error) {
          return tw_scene_new(meshes.data(), meshes.size(), other_lights, error);
        })) {}
  Numbers indicators(const tw_camera &camera) const {
    Numbers numbers(TW_SCENE_INDICATORS);
    detail::checked(
        [&](tw_error **error) { return tw_scene_indicators(owned_.get(), &camera, numbers.data(), error); });
    return numbers;
  }

 private:
  detail::Owned<tw_scene> owned_;
};

}  // namespace tw

#endif
