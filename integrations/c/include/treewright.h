/* Treewright's client SDK for C: ask what to run next, run it, tell how long it took.
 *
 *   tw_error *error = NULL;
 *   tw_client *client = tw_client_connect("http://127.0.0.1:50611", NULL, &error);
 *   tw_spec *spec = tw_spec_new();
 *   tw_spec_integer(spec, "max_leaf_size", 1, 32, 8, TW_LOG);
 *   tw_spec_indicator(spec, "triangles", 0, 1e8, TW_LOG);
 *   tw_spec_minimise(spec, "render_ms", 1);
 *   tw_study *study = tw_client_study(client, "my-renderer", spec, &error);
 *   tw_number input[] = {{"triangles", 262267}};
 *   tw_suggestion *suggestion = tw_study_suggest(study, input, 1, &error);
 *   ... build and render with tw_suggestion_configuration(suggestion) ...
 *   tw_number result[] = {{"render_ms", render_ms}};
 *   tw_suggestion_report(suggestion, result, 1, &error);
 *
 * Ownership. What a function returns as a pointer without const is the caller's and is freed by the tw_..._free of its
 * type; functions that are said to CONSUME a handle free it, whether they succeed or not. Pointers to const are borrowed and
 * live as long as what they were got from. Text is UTF-8 and ends in a zero; what is handed in is copied. A handle may be freed
 * before those that were made of it. Freeing NULL does nothing; any other function given NULL for a handle fails, or
 * answers as documented.
 *
 * Errors. Functions that can fail take `tw_error **error` last and return NULL or false when they failed. `error` may be
 * NULL; else *error is set on failure, and left alone on success. Free it with tw_error_free. There is no global state.
 *
 * Threads. tw_client, tw_study, tw_tuner and tw_scene may be used by several threads at once. Other handles
 * may move between threads but be used by one at a time; const ones may be read by several. Each suggestion that is open is a
 * trial of its own, whichever thread asked for it. One background thread per client does the network. In the child of a fork
 * clients, studies and tuners connect again at their first use; suggestions remain the parent's (TW_INVALID).
 *
 * Waiting. tw_study_suggest and tw_tuner_next wait for the daemon no longer than the deadline (50 ms unless the options say
 * otherwise) and then hand out the last good configuration, or the default. Reports go into a bounded queue and return at once;
 * they are sent again until they are acknowledged. Other calls wait for the call deadline (5 s).
 */
#ifndef TREEWRIGHT_H
#define TREEWRIGHT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The interface's version. Libraries with the same major version (0: the same minor version, too) fit each other, and have the same
 * name for the loader: libtreewright.so.0.1 for all of 0.1. */
#define TREEWRIGHT_VERSION_MAJOR 0
#define TREEWRIGHT_VERSION_MINOR 1
#define TREEWRIGHT_VERSION_PATCH 0

typedef struct tw_error tw_error;
typedef struct tw_options tw_options;
typedef struct tw_client tw_client;
typedef struct tw_spec tw_spec;
typedef struct tw_study tw_study;
typedef struct tw_tuner tw_tuner;
typedef struct tw_front tw_front;
typedef struct tw_front_runs tw_front_runs;
typedef struct tw_front_run tw_front_run;
typedef struct tw_suggestion tw_suggestion;
typedef struct tw_configuration tw_configuration;
typedef struct tw_scene tw_scene;

/* A number with its name: an indicator or a measurement. Finite; measurements are not negative. */
typedef struct tw_number {
  const char *name;
  double value;
} tw_number;

/* ---- errors ------------------------------------------------------------------------------------------------------- */

enum tw_code {
  TW_OK = 0,
  TW_INVALID = 1,       /* an argument is wrong; nothing was sent */
  TW_AWAY = 2,          /* no daemon answers */
  TW_LATE = 3,          /* the daemon took longer than the deadline */
  TW_REFUSED = 4,       /* the daemon will not do it; see tw_error_grpc_code */
  TW_MALFORMED = 5,     /* the daemon's answer makes no sense: of another version? */
  TW_NO_SUCH_VALUE = 6, /* the configuration has no value of that name and type */
  TW_UNFLUSHED = 7,     /* reports are still waiting */
  TW_BUSY = 8,          /* too much is under way */
  TW_NO_THREAD = 9,     /* the client's thread could not be started */
  TW_INTERNAL = 10      /* a defect of this library */
};

/* One of enum tw_code; TW_OK for NULL. */
int32_t tw_error_code(const tw_error *error);
/* The canonical gRPC code of a refusal, else 0. */
int32_t tw_error_grpc_code(const tw_error *error);
/* Cause and remedy in one sentence; empty for NULL. Borrowed from the error. */
const char *tw_error_message(const tw_error *error);
void tw_error_free(tw_error *error);

/* ---- options of a client; tw_client_connect reports a mistake ------------------------------------------------------ */

/* Defaults that suit a renderer on the daemon's machine. */
tw_options *tw_options_new(void);
void tw_options_free(tw_options *options);
/* Who this is: 1 to 128 printable characters, unique among the machines that work on a study. Threads and processes of one
 * machine get names of their own, as ID, ID#2, ID#3 and so on. Default: program, machine, user, and a number for each process. */
void tw_options_client_id(tw_options *options, const char *client_id);
/* How long a suggestion may keep a frame waiting, connecting included. Default 50. */
void tw_options_deadline_ms(tw_options *options, double ms);
/* How long any other call may take. Default 5000. */
void tw_options_call_deadline_ms(tw_options *options, double ms);
/* How many reports may wait, 1 to 1048576; the oldest is dropped when it is full. Default 1024. */
void tw_options_queue(tw_options *options, size_t reports);
/* Promises that every trial is stopped at tw_suggestion_abort_above. Default false. */
void tw_options_can_abort(tw_options *options, bool can_abort);
/* Promises that every trial runs at the level of tw_suggestion_fidelity. Default false: all are full ones. */
void tw_options_fidelities(tw_options *options, bool fidelities);
/* Names a piece of software whose version decides how fast something is, such as ("embree", "4.4.0"). */
void tw_options_software(tw_options *options, const char *name, const char *version);
/* Shows a token, as `treewrightd token create` printed it; or the one that a file holds. */
void tw_options_token(tw_options *options, const char *token);
void tw_options_token_file(tw_options *options, const char *path);
/* Trusts a daemon whose certificate comes from an authority of this PEM file, and no other. Only for https: addresses. */
void tw_options_authority_file(tw_options *options, const char *path);
/* Shows the certificate of these PEM files. Only for https: addresses. */
void tw_options_certificate_files(tw_options *options, const char *certificate, const char *key);

/* ---- what a study is; tw_client_study reports a mistake ------------------------------------------------------------- */

enum tw_scale { TW_LINEAR = 0, TW_LOG = 1 };

tw_spec *tw_spec_new(void);
void tw_spec_free(tw_spec *spec);
/* A parameter: its name, its range with both ends, and the value used so far, against which everything is judged. */
void tw_spec_integer(tw_spec *spec, const char *name, int64_t min, int64_t max, int64_t default_value, int32_t scale);
void tw_spec_float(tw_spec *spec, const char *name, double min, double max, double default_value, int32_t scale);
void tw_spec_boolean(tw_spec *spec, const char *name, bool default_value);
/* One of 1 to 64 words, which have no order, or numbers, which are searched in the order of their sizes. */
void tw_spec_choice(tw_spec *spec, const char *name, const char *const *values, size_t count, const char *default_value);
void tw_spec_choice_number(tw_spec *spec, const char *name, const double *values, size_t count, double default_value);
void tw_spec_choice_integer(tw_spec *spec, const char *name, const int64_t *values, size_t count, int64_t default_value);
/* The last parameter exists only while an earlier one has this value, written as text; again for further values. */
void tw_spec_active_if(tw_spec *spec, const char *parameter, const char *value);
/* A change of the last parameter needs a set-up, such as a build; that of all others only a run. */
void tw_spec_setup(tw_spec *spec);
/* Every configuration has lesser <= greater. */
void tw_spec_less_or_equal(tw_spec *spec, const char *lesser, const char *greater);
/* The last parameter, an integer, has only values that are so far apart from each other, from the smallest on. */
void tw_spec_step(tw_spec *spec, int64_t step);
/* Every configuration fulfils an expression, such as "block_x * block_y <= 1024 and block_x % 4 == 0". */
void tw_spec_constraint(tw_spec *spec, const char *expression);
/* A number that describes the input, with the range that is mapped to 0..1. */
void tw_spec_indicator(tw_spec *spec, const char *name, double min, double max, int32_t scale);
/* A measurement that is to become small; the objective is the sum of weight times measurement. */
void tw_spec_minimise(tw_spec *spec, const char *metric, double weight);
/* A measurement that is to be large, such as a rate, above 0: the cost is its weight over it. */
void tw_spec_maximise(tw_spec *spec, const char *metric, double weight);
/* A measurement that explains a cost and is not minimised, such as processor time. */
void tw_spec_auxiliary(tw_spec *spec, const char *metric);
/* Limits of a measurement; -INFINITY or INFINITY for none on that side. A run beyond one is infeasible, and every report
 * with a cost has to hold the measurement. */
void tw_spec_limit(tw_spec *spec, const char *metric, double at_least, double at_most);
/* Frames of a trial, 1 to 64, for costs that rise or fall while a configuration is in use. A tw_tuner keeps a trial for this
 * number of frames and reports their means. A trial of tw_study_suggest is reported with the means over them. Default 1. */
void tw_spec_episode_frames(tw_spec *spec, uint32_t frames);
/* A cheaper level, such as fewer samples, the cheapest first: the cost of a trial there as a share of a full one. At most 4. */
void tw_spec_fidelity(tw_spec *spec, const char *name, double cost);
/* A field of the policy, written as on the command line: ("epsilon", "0.1"). */
void tw_spec_policy(tw_spec *spec, const char *field, const char *value);
/* A line for people. */
void tw_spec_display_name(tw_spec *spec, const char *text);
/* How far normalised indicators may differ within one state, 0 to 1. Default 0.01. */
void tw_spec_state_tolerance(tw_spec *spec, double tolerance);
/* Seed of the service's random decisions. Default 0. */
void tw_spec_seed(tw_spec *spec, uint64_t seed);

/* ---- the client ------------------------------------------------------------------------------------------------- */

/* Makes a client with a thread of its own. Asks nobody yet: an absent daemon is no error. options may be NULL and remain the
 * caller's. Fails: TW_INVALID, TW_NO_THREAD. */
tw_client *tw_client_connect(const char *url, const tw_options *options, tw_error **error);
/* With the last handle of the client gone, waiting reports are sent for at most two more seconds. */
void tw_client_free(tw_client *client);
/* How long an answer takes; ms may be NULL. Fails: TW_AWAY, TW_LATE. */
bool tw_client_ping(const tw_client *client, double *ms, tw_error **error);
/* Waits until every report is acknowledged. Fails: TW_UNFLUSHED. */
bool tw_client_flush(const tw_client *client, double deadline_ms, tw_error **error);

enum tw_count {
  TW_COUNT_SUGGESTIONS = 0,  /* suggestions from the daemon, in time */
  TW_COUNT_FALLBACKS = 1,    /* answered without the daemon */
  TW_COUNT_UNREPORTED = 2,   /* results of fallbacks: there is no trial to report them to */
  TW_COUNT_SENT = 3,         /* attempts to send a report */
  TW_COUNT_ACKNOWLEDGED = 4, /* reports that the daemon has stored */
  TW_COUNT_RESENT = 5,       /* attempts to send one again */
  TW_COUNT_REFUSED = 6,      /* refused for good */
  TW_COUNT_DROPPED = 7,      /* lost */
  TW_COUNT_ABANDONED = 8,    /* trials given back */
  TW_COUNT_QUEUED = 9        /* waiting or on their way now */
};
/* Counts of suggestions and reports since the client was made; 0 for a number that is unknown. */
uint64_t tw_client_count(const tw_client *client, int32_t which);

/* Creates the study, or finds the equal one of that id: 1 to 64 of a-z, 0-9, - and _. An absent daemon is no error: the study is
 * created when it is there. spec remains the caller's. Fails: TW_INVALID, TW_REFUSED, TW_MALFORMED. */
tw_study *tw_client_study(const tw_client *client, const char *id, const tw_spec *spec, tw_error **error);
/* A study that exists already. Fails: TW_REFUSED, TW_AWAY, TW_LATE. */
tw_study *tw_client_existing_study(const tw_client *client, const char *id, tw_error **error);
/* Deletes a study with everything learnt. Fails: TW_REFUSED, TW_AWAY, TW_LATE. */
bool tw_client_delete_study(const tw_client *client, const char *id, tw_error **error);
/* The effect of a change of a space on the trials of its study. */
typedef struct tw_changed_space {
  uint32_t revision;         /* of the space, after the change or, where it was only tried, as it is */
  int64_t kept_trials;       /* completed ones inside the new space */
  int64_t outside_trials;    /* completed ones outside, which are kept and not used */
  int64_t given_back_trials; /* open ones outside */
} tw_changed_space;
/* Changes the space of a study for all programs to the parameters and constraints of spec, of which nothing else is looked at; spec
 * remains the caller's. Trials stay. Programs that know the space of before go on in it; tw_client_study with the new one works in
 * that. fixed_json, a JSON object or NULL, has values of parameters that are added or removed, where they are not the defaults: what
 * all trials before had of one that is added, and what all from now on have of one that is removed. With only_try nothing is changed.
 * changed may be NULL. Fails: TW_INVALID, TW_REFUSED, TW_AWAY, TW_LATE. */
bool tw_client_change_space(const tw_client *client, const char *id, const tw_spec *spec, const char *fixed_json, bool only_try,
                            tw_changed_space *changed, tw_error **error);
/* Renews the lease of an open suggestion, counted from now, for work that takes longer than lease_s of the policy. Does nothing for
 * a fallback. Fails: TW_REFUSED where the daemon has ended the trial, TW_AWAY, TW_LATE, TW_INVALID in the child of a fork. */
bool tw_client_extend_lease(const tw_client *client, tw_suggestion *suggestion, tw_error **error);

/* ---- a study ---------------------------------------------------------------------------------------------------- */

void tw_study_free(tw_study *study);
/* The next configuration for these indicators, within the deadline. Fails only for arguments that are none (TW_INVALID).
 * tw_suggestion_problem says what else went wrong. */
tw_suggestion *tw_study_suggest(const tw_study *study, const tw_number *indicators, size_t count, tw_error **error);
/* A trial of the caller's own configuration, as JSON. Fails: TW_INVALID, TW_REFUSED, TW_AWAY, TW_LATE. */
tw_suggestion *tw_study_trial_of(const tw_study *study, const tw_number *indicators, size_t count,
                                 const char *configuration_json, tw_error **error);
/* Sets what the program runs by default, as JSON with all its values, where that is not the study's default; NULL for that. It is
 * measured first in a state, and answers there are what is better than it. Fails: TW_INVALID. */
bool tw_study_set_start(const tw_study *study, const char *configuration_json, tw_error **error);
/* What would be exploited; *cost, if not NULL, becomes the predicted objective or NaN. tw_configuration_reason says whether it
 * was measured for such an input or is only predicted. Fails: TW_INVALID for wrong indicators, TW_REFUSED, TW_AWAY, TW_LATE. */
tw_configuration *tw_study_predict(const tw_study *study, const tw_number *indicators, size_t count, double *cost,
                                   tw_error **error);
/* The best known, of all states with count 0; *cost, if not NULL, becomes its mean objective. Fails as tw_study_predict;
 * TW_REFUSED when nothing was measured there. */
tw_configuration *tw_study_best(const tw_study *study, const tw_number *indicators, size_t count, double *cost,
                                tw_error **error);

enum tw_stage {
  TW_STAGE_UNKNOWN = 0,       /* the daemon does not tell */
  TW_STAGE_OFF = 1,           /* the policy wants no confirmation */
  TW_STAGE_SEARCHING = 2,     /* the search goes on */
  TW_STAGE_RACING = 3,        /* the best few run against the incumbent */
  TW_STAGE_BETTER = 4,        /* a challenger is the answer: proven better, or likely to be */
  TW_STAGE_NOTHING_BETTER = 5 /* none was shown to be better */
};

/* The standing of an answer. An unknown number is NaN. Intervals are those of 95 %. */
typedef struct tw_standing {
  double cost; /* from all that was measured, never the luckiest run */
  double cost_low;
  double cost_high;
  double gain; /* the share by which it lies below the default's cost */
  double gain_low;
  double gain_high;
  double probability_better;
  int32_t stage;       /* one of enum tw_stage */
  bool nothing_better; /* the answer is what was run before */
  double default_cost; /* mean objective of the default there */
  int32_t measurements; /* how many the mean objective of the answer rests on */
  const char *status;  /* what is proven, in a word or two: proven better, likely better, searching, confirming, open, nothing better,
                        * nothing to win; empty where the daemon does not tell */
  const char *verdict; /* the same as a sentence */
  const char *trial;   /* name of the most recent one that measured the answer */
} tw_standing;

/* As tw_study_best, and fills *standing, whose texts are borrowed from the configuration. */
tw_configuration *tw_study_best_standing(const tw_study *study, const tw_number *indicators, size_t count, double *cost,
                                         tw_standing *standing, tw_error **error);

/* The value behind a cost of the study: the metric in its own unit where one is maximised and nothing else counts, else the cost. The
 * ends of an interval change places there. NaN for NULL. */
double tw_study_value(const tw_study *study, double cost);

/* The Pareto front of the stored trials, without those that are excluded, ran at a cheaper level, or are outside the present space.
 * metrics are two or three measurements, which the study need not minimise, such as "time_ms" and "1/rate", which is to be large; with
 * count 0 those that the study was made for. state is the number of a state, needed where trials are of several inputs or machines,
 * which do not compare; else 0. Fails: TW_INVALID, TW_REFUSED, TW_AWAY, TW_LATE. */
tw_front *tw_study_front(const tw_study *study, const char *const *metrics, size_t count, int64_t state, tw_error **error);
/* An object with points, the best of the first metric first, and default, which may be null: each has configuration, runs, metrics
 * (medians by name) and ratios (to the default's). Beside them metrics, maximised, runs, configurations and hypervolume, the share, 0
 * to 1, of the box between zero and the default that the front leaves behind. Borrowed. */
const char *tw_front_json(const tw_front *front);
void tw_front_free(tw_front *front);

/* Looks for the Pareto front of count metrics, two or three, all above 0 in every run; "1/rate" is one that is to be large. Creates the
 * study, or goes on with the one of that id that was made for the same metrics; the specification has neither metrics nor indicators.
 * planned is the number of runs, for example 80. One program at a time adds to a front, and runs one trial at a time. Each call of a
 * front waits for the daemon. Fails: TW_INVALID, TW_REFUSED, TW_AWAY, TW_LATE, as all of the next ones. */
tw_front_runs *tw_client_front_runs(const tw_client *client, const char *id, const tw_spec *spec, const char *const *metrics,
                                    size_t count, uint32_t planned, tw_error **error);
/* The next run; the same one until it is reported or given back. NULL without an error once the planned ones are done, or nothing more
 * is to be tried. */
tw_front_run *tw_front_runs_suggest(const tw_front_runs *runs, tw_error **error);
/* The front of all runs so far on this machine. */
tw_front *tw_front_runs_found(const tw_front_runs *runs, tw_error **error);
void tw_front_runs_free(tw_front_runs *runs);
/* Borrowed from the run, as its trial's name. */
const tw_configuration *tw_front_run_configuration(const tw_front_run *run);
const char *tw_front_run_trial(const tw_front_run *run);
/* Each CONSUMES the run. Where it fails, tw_front_runs_suggest gives the same one again. Of a report every metric is wanted, above 0. */
bool tw_front_run_report(tw_front_run *run, const tw_number *measurements, size_t count, tw_error **error);
bool tw_front_run_infeasible(tw_front_run *run, const char *reason, tw_error **error);
bool tw_front_run_failed(tw_front_run *run, const char *reason, tw_error **error);
/* Gives the run back unmeasured. */
void tw_front_run_free(tw_front_run *run);

/* A frame loop in which report and question travel together: one round trip a frame. Fails: TW_INVALID. */
tw_tuner *tw_tuner_new(const tw_study *study, tw_error **error);
/* A result that was not sent yet goes into the queue. */
void tw_tuner_free(tw_tuner *tuner);
/* As tw_study_suggest, and sends what tw_tuner_finish left. Where trials have several frames it gives the same one again for so
 * many, at once and without the daemon; in another state an unfinished one is given back. */
tw_suggestion *tw_tuner_next(const tw_tuner *tuner, const tw_number *indicators, size_t count, tw_error **error);
/* CONSUMES the suggestion: its result is sent with the next question. Fails as tw_suggestion_report. */
bool tw_tuner_finish(const tw_tuner *tuner, tw_suggestion *suggestion, const tw_number *measurements, size_t count,
                     tw_error **error);

/* ---- a suggestion ----------------------------------------------------------------------------------------------- */

enum tw_source {
  TW_DAEMON = 0,    /* the daemon, in time */
  TW_LAST_GOOD = 1, /* the daemon did not answer: its latest answer that ran in this state and has not failed since, else the
                     * cheapest configuration that did; where nothing ran here, its latest answer that failed nowhere */
  TW_DEFAULT = 2    /* the daemon did not answer, and there is none of these: the start, else the defaults */
};

/* Borrowed from the suggestion. NULL for NULL. */
const tw_configuration *tw_suggestion_configuration(const tw_suggestion *suggestion);
/* One of enum tw_source. */
int32_t tw_suggestion_source(const tw_suggestion *suggestion);
/* Name of the trial; empty for a fallback. Borrowed, like the next two. */
const char *tw_suggestion_trial(const tw_suggestion *suggestion);
/* Why this configuration, in a sentence. */
const char *tw_suggestion_reason(const tw_suggestion *suggestion);
/* Why the daemon was not the source; NULL when it was. */
const char *tw_suggestion_problem(const tw_suggestion *suggestion);
/* Predicted objective; NaN where nothing is known. */
double tw_suggestion_predicted_cost(const tw_suggestion *suggestion);
/* Stop as soon as the objective exceeds this, and call tw_suggestion_aborted. Infinite: never. */
double tw_suggestion_abort_above(const tw_suggestion *suggestion);
/* The name of the cheaper level at which to run; NULL for a full trial. Valid as long as the suggestion. */
const char *tw_suggestion_fidelity(const tw_suggestion *suggestion);
/* Whether what was set up for the trial before serves this one: that was measured to its end, with the same values of all
 * parameters of tw_spec_setup. False for NULL, and always where a process runs trials of the study side by side. */
bool tw_suggestion_is_prepared(const tw_suggestion *suggestion);

/* The standard errors of measurements that are estimates, before they are reported or finished: poor ones count for less. */
bool tw_suggestion_standard_errors(tw_suggestion *suggestion, const tw_number *errors, size_t count, tw_error **error);

/* Each CONSUMES the suggestion and returns at once; the result is sent in the background. Fails: TW_INVALID, e.g. for a
 * measurement that is not finite; the trial is then given back. */
bool tw_suggestion_report(tw_suggestion *suggestion, const tw_number *measurements, size_t count, tw_error **error);
/* Stopped early: the objective is at least lower_bound. */
bool tw_suggestion_aborted(tw_suggestion *suggestion, double lower_bound, tw_error **error);
/* The configuration cannot work for this input. */
bool tw_suggestion_infeasible(tw_suggestion *suggestion, const char *reason, tw_error **error);
/* It failed for a reason that says nothing about the configuration. */
bool tw_suggestion_failed(tw_suggestion *suggestion, const char *reason, tw_error **error);
/* Gives the trial back unmeasured. */
void tw_suggestion_free(tw_suggestion *suggestion);

/* ---- a configuration ---------------------------------------------------------------------------------------------- */

/* Fail with TW_NO_SUCH_VALUE, which says what there is instead; *value is then left alone. */
bool tw_configuration_integer(const tw_configuration *configuration, const char *name, int64_t *value, tw_error **error);
bool tw_configuration_float(const tw_configuration *configuration, const char *name, double *value, tw_error **error);
bool tw_configuration_boolean(const tw_configuration *configuration, const char *name, bool *value, tw_error **error);
/* Borrowed from the configuration. */
const char *tw_configuration_text(const tw_configuration *configuration, const char *name, tw_error **error);
/* Whether it has that parameter: one that does not act is not there. */
bool tw_configuration_has(const tw_configuration *configuration, const char *name);
/* {"quality":2,"split":"sah"}. Borrowed. */
const char *tw_configuration_json(const tw_configuration *configuration);
/* Of tw_study_predict why it is the answer, of tw_study_best_standing the verdict, in a sentence; else empty. Borrowed. */
const char *tw_configuration_reason(const tw_configuration *configuration);
/* Reads that JSON; asks no daemon. Fails: TW_INVALID. */
tw_configuration *tw_configuration_new(const char *json, tw_error **error);
/* For those of tw_configuration_new, tw_study_predict, tw_study_best and tw_study_best_standing; not for borrowed ones. */
void tw_configuration_free(tw_configuration *configuration);

/* ---- the seventeen indicators of a scene -------------------------------------------------------------------------- */

enum { TW_SCENE_INDICATORS = 17 };

/* A mesh in the renderer's own buffers, which are read during tw_scene_new alone. A stride of 0 means side by side. */
typedef struct tw_mesh {
  const float *vertices;   /* x, y, z */
  size_t vertex_stride;    /* bytes from one vertex to the next */
  size_t vertex_count;
  const uint32_t *indices; /* three a triangle */
  size_t index_stride;     /* bytes from one triangle to the next */
  size_t triangle_count;
  const float *transform;  /* NULL, or the columns of a 3x4 matrix to the world (RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR) */
  double diffuse_share;    /* 1 for a matt surface, 0 for a mirror or clear glass */
  bool emits;              /* whether it is a light source */
} tw_mesh;

typedef struct tw_camera {
  float position[3];
  float target[3];
  float vertical_fov_deg;
} tw_camera;

/* Goes once through all triangles (some 10 ns each). other_lights are those that are no mesh. Fails: TW_INVALID. */
tw_scene *tw_scene_new(const tw_mesh *meshes, size_t count, uint32_t other_lights, tw_error **error);
void tw_scene_free(tw_scene *scene);
/* The indicators with this camera, in under a microsecond; their names live forever. Fails: TW_INVALID. */
bool tw_scene_indicators(const tw_scene *scene, const tw_camera *camera, tw_number indicators[TW_SCENE_INDICATORS],
                         tw_error **error);
/* Adds those indicators to a study. */
void tw_spec_scene_indicators(tw_spec *spec);

#ifdef __cplusplus
}
#endif

#endif
