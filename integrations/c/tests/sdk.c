/* Exercises libtreewright from plain C against a running daemon: `sdk URL`. Ends with 0 and `ok`, or names what failed. */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "treewright.h"

#define CHECK(condition)                                                       \
  do {                                                                         \
    if (!(condition)) {                                                        \
      fprintf(stderr, "%s:%d: %s does not hold\n", __FILE__, __LINE__, #condition); \
      exit(1);                                                                 \
    }                                                                          \
  } while (0)

static void expect(tw_error *error, int32_t code, const char *words) {
  if (tw_error_code(error) != code || !strstr(tw_error_message(error), words)) {
    fprintf(stderr, "expected %d with %s, got %d: %s\n", code, words, tw_error_code(error), tw_error_message(error));
    exit(1);
  }
  tw_error_free(error);
}

/* A call that is given `&error` fails. */
#define FAILS(call, code, words)                                               \
  do {                                                                         \
    tw_error *error = NULL;                                                    \
    CHECK(!(call));                                                            \
    expect(error, code, words);                                                \
  } while (0)

static void succeed(tw_error *error) {
  if (error) {
    fprintf(stderr, "failed: %s\n", tw_error_message(error));
    exit(1);
  }
}

static tw_spec *new_spec(void) {
  static const char *const splits[] = {"sah", "median"};
  static const double budgets[] = {1.2, 2.0};
  static const int64_t tiles[] = {16, 32, 64, 128};
  tw_spec *spec = tw_spec_new();
  tw_spec_display_name(spec, "a study from C");
  tw_spec_integer(spec, "leaf", 1, 32, 8, TW_LOG);
  tw_spec_integer(spec, "block", 8, 72, 24, TW_LINEAR);
  tw_spec_step(spec, 16);
  tw_spec_choice(spec, "split", splits, 2, "sah");
  tw_spec_boolean(spec, "compact", false);
  tw_spec_float(spec, "cost", 0.5, 4, 1, TW_LINEAR);
  tw_spec_active_if(spec, "split", "sah");
  tw_spec_choice_number(spec, "budget", budgets, 2, 1.2);
  tw_spec_choice_integer(spec, "tile", tiles, 4, 64);
  tw_spec_constraint(spec, "leaf % 5 != 4 or compact and leaf < 10");
  tw_spec_indicator(spec, "triangles", 0, 1e8, TW_LOG);
  tw_spec_minimise(spec, "render_ms", 1);
  tw_spec_limit(spec, "render_ms", -INFINITY, 1e6);
  tw_spec_policy(spec, "epsilon", "0.5");
  tw_spec_seed(spec, 7);
  return spec;
}

/* The study of a specification, which is used up. */
static tw_study *opened(const tw_client *client, const char *id, tw_spec *spec) {
  tw_error *error = NULL;
  tw_study *study = tw_client_study(client, id, spec, &error);
  succeed(error);
  tw_spec_free(spec);
  return study;
}

/* A frame whose time depends on the configuration alone. */
static double render(const tw_configuration *configuration) {
  int64_t leaf = 0, block = 0, tile = 0;
  bool compact = true;
  tw_error *error = NULL;
  CHECK(tw_configuration_integer(configuration, "leaf", &leaf, &error));
  CHECK(tw_configuration_boolean(configuration, "compact", &compact, &error));
  CHECK(tw_configuration_integer(configuration, "block", &block, &error) && block % 16 == 8);
  CHECK(tw_configuration_integer(configuration, "tile", &tile, &error) && tile >= 16 && tile <= 128 && 128 % tile == 0);
  CHECK(leaf >= 1 && leaf <= 32 && (leaf % 5 != 4 || (compact && leaf < 10)));
  return 5 + fabs((double)leaf - 3) + (compact ? 2 : 0);
}

static void without_handles(void) {
  double ms;
  FAILS(tw_client_ping(NULL, &ms, &error), TW_INVALID, "the client is NULL");
  CHECK(!tw_client_extend_lease(NULL, NULL, NULL) && !tw_study_front(NULL, NULL, 0, 0, NULL) && tw_front_json(NULL)[0]);
  CHECK(!tw_study_suggest(NULL, NULL, 0, NULL));
  CHECK(!tw_suggestion_report(NULL, NULL, 0, NULL) && !tw_suggestion_standard_errors(NULL, NULL, 0, NULL));
  CHECK(tw_suggestion_configuration(NULL) == NULL && !tw_suggestion_is_prepared(NULL) && tw_error_code(NULL) == TW_OK);
  CHECK(tw_suggestion_trial(NULL)[0] == 0 && tw_client_count(NULL, TW_COUNT_SENT) == 0);
  CHECK(!tw_front_runs_suggest(NULL, NULL) && !tw_front_run_report(NULL, NULL, 0, NULL) && tw_front_run_trial(NULL)[0] == 0);
  tw_front_runs_free(NULL);
  tw_front_run_free(NULL);
  tw_client_free(NULL);
  tw_study_free(NULL);
  tw_tuner_free(NULL);
  tw_suggestion_free(NULL);
  tw_configuration_free(NULL);
  tw_spec_free(NULL);
  tw_options_free(NULL);
  tw_scene_free(NULL);
  tw_error_free(NULL);
}

static void mistakes(const tw_client *client) {
  tw_error *error = NULL;
  FAILS(tw_client_connect("not an address", NULL, &error), TW_INVALID, "not an address");
  tw_options *options = tw_options_new();
  tw_options_deadline_ms(options, NAN);
  tw_options_client_id(options, "\xff");
  FAILS(tw_client_connect("http://127.0.0.1:1", options, &error), TW_INVALID, "deadline of NaN ms");
  tw_options_free(options);
  options = tw_options_new();
  tw_options_authority_file(options, "/dev/null");
  FAILS(tw_client_connect("http://127.0.0.1:1", options, &error), TW_INVALID,
        "certificate authority: it is only used with TLS");
  tw_options_certificate_files(options, "/dev/null", "/dev/null");
  FAILS(tw_client_connect("http://127.0.0.1:1", options, &error), TW_INVALID, "client certificate: it is only used with TLS");
  tw_options_free(options);
  tw_spec *spec = new_spec();
  tw_spec_integer(spec, "leaf", 0, 3, 1, TW_LINEAR);
  FAILS(tw_client_study(client, "twice", spec, &error), TW_INVALID, "listed twice");
  tw_spec_free(spec);
  spec = new_spec();
  tw_spec_active_if(spec, "nothing", "1");
  FAILS(tw_client_study(client, "condition", spec, &error), TW_INVALID, "no parameter \"nothing\"");
  tw_spec_free(spec);
  spec = new_spec();
  tw_spec_constraint(spec, "leaf * 2 <=");
  FAILS(tw_client_study(client, "constraint", spec, &error), TW_INVALID, "at character 12");
  tw_spec_free(spec);
  CHECK(!tw_client_existing_study(client, "nowhere", &error));
  CHECK(tw_error_grpc_code(error) == 5);
  expect(error, TW_REFUSED, "nowhere");
}

static void without_daemon(void) {
  tw_error *error = NULL;
  tw_client *client = tw_client_connect("http://127.0.0.1:1", NULL, &error);
  tw_study *study = opened(client, "away", new_spec());
  tw_number input[] = {{"triangles", 1000}};
  tw_suggestion *suggestion = tw_study_suggest(study, input, 1, &error);
  succeed(error);
  CHECK(tw_suggestion_source(suggestion) == TW_DEFAULT);
  CHECK(strstr(tw_suggestion_problem(suggestion), "no daemon answers"));
  CHECK(render(tw_suggestion_configuration(suggestion)) == 10);
  CHECK(tw_client_extend_lease(client, suggestion, &error));
  tw_number result[] = {{"render_ms", 10}};
  CHECK(tw_suggestion_report(suggestion, result, 1, &error));
  CHECK(tw_client_count(client, TW_COUNT_UNREPORTED) == 1 && tw_client_count(client, TW_COUNT_FALLBACKS) == 1);
  FAILS(tw_study_best(study, NULL, 0, NULL, &error), TW_AWAY, "start one with");
  /* A program with a default of its own runs that. */
  const char *start = "{\"leaf\":3,\"block\":24,\"split\":\"median\",\"compact\":false,\"budget\":1.2,\"tile\":64}";
  CHECK(tw_study_set_start(study, start, &error));
  suggestion = tw_study_suggest(study, input, 1, &error);
  CHECK(tw_suggestion_source(suggestion) == TW_DEFAULT && render(tw_suggestion_configuration(suggestion)) == 5);
  CHECK(strstr(tw_suggestion_reason(suggestion), "the program's own default"));
  tw_suggestion_free(suggestion);
  tw_client_free(client); /* before its study */
  tw_study_free(study);
}

static void maximised(const tw_client *client) {
  tw_error *error = NULL;
  tw_spec *spec = tw_spec_new();
  tw_spec_integer(spec, "level", 1, 9, 5, TW_LINEAR);
  tw_spec_maximise(spec, "fps", 1000);
  tw_study *study = opened(client, "from-c-maximised", spec);
  tw_suggestion *suggestion = tw_study_suggest(study, NULL, 0, &error);
  succeed(error);
  tw_number result[] = {{"fps", 50}};
  CHECK(tw_suggestion_report(suggestion, result, 1, &error));
  CHECK(tw_client_flush(client, 20000, &error));
  double cost;
  tw_configuration *found = tw_study_best(study, NULL, 0, &cost, &error);
  succeed(error);
  CHECK(cost == 20 && tw_study_value(study, cost) == 50);
  tw_configuration_free(found);
  tw_study_free(study);
}

static tw_spec *levels(bool with_threads) {
  tw_spec *spec = tw_spec_new();
  tw_spec_integer(spec, "level", 1, 9, 5, TW_LINEAR);
  if (with_threads) tw_spec_integer(spec, "threads", 1, 4, 2, TW_LINEAR);
  tw_spec_minimise(spec, "ms", 1);
  return spec;
}

/* A program of before goes on in the space that it knows, and one of today gets the new parameter. */
static void changed_space(const tw_client *client) {
  tw_error *error = NULL;
  tw_spec *specs[] = {levels(false), levels(true)};
  tw_study *studies[2];
  tw_number result[] = {{"ms", 5}, {"mb", 2}};
  studies[0] = tw_client_study(client, "from-c-space", specs[0], &error);
  succeed(error);
  CHECK(tw_suggestion_report(tw_study_suggest(studies[0], NULL, 0, NULL), result, 2, &error));
  CHECK(tw_client_flush(client, 20000, &error));
  tw_changed_space changed;
  CHECK(tw_client_change_space(client, "from-c-space", specs[1], NULL, true, &changed, &error));
  CHECK(changed.revision == 1 && changed.kept_trials == 1 && changed.outside_trials == 0 && changed.given_back_trials == 0);
  CHECK(tw_client_change_space(client, "from-c-space", specs[1], "{\"threads\":3}", false, &changed, &error));
  CHECK(changed.revision == 2);
  studies[1] = tw_client_study(client, "from-c-space", specs[1], &error);
  succeed(error);
  for (int each = 0; each < 2; each++) {
    tw_suggestion *suggestion = tw_study_suggest(studies[each], NULL, 0, &error);
    succeed(error);
    CHECK(tw_suggestion_source(suggestion) == TW_DAEMON);
    CHECK(tw_configuration_has(tw_suggestion_configuration(suggestion), "threads") == (each == 1));
    CHECK(tw_suggestion_report(suggestion, result, 2, &error) && tw_client_flush(client, 20000, &error));
  }
  static const char *const metrics[] = {"ms", "1/mb"};
  tw_front *front = tw_study_front(studies[1], metrics, 2, 0, &error);
  succeed(error);
  CHECK(strstr(tw_front_json(front), "\"maximised\":[\"mb\"],\"runs\":3") && strstr(tw_front_json(front), "\"threads\":"));
  tw_front_free(front);
  FAILS(tw_study_front(studies[1], NULL, 0, 0, &error), TW_INVALID, "made for none");
  FAILS(tw_client_change_space(client, "from-c-space", specs[0], "{]", false, NULL, &error), TW_INVALID, "no JSON");
  FAILS(tw_client_change_space(client, "nowhere", specs[0], NULL, false, NULL, &error), TW_REFUSED, "nowhere");
  CHECK(tw_client_delete_study(client, "from-c-space", &error));
  for (int each = 0; each < 2; each++) {
    tw_study_free(studies[each]);
    tw_spec_free(specs[each]);
  }
}

/* Two metrics of which none is given up: the runs, what is refused, and what was found. */
static void fronts(const tw_client *client) {
  static const char *const metrics[] = {"ms", "1/rate"};
  tw_error *error = NULL;
  tw_spec *spec = tw_spec_new();
  tw_spec_integer(spec, "level", 1, 50, 25, TW_LINEAR);
  tw_front_runs *runs = tw_client_front_runs(client, "from-c-front", spec, metrics, 2, 6, &error);
  succeed(error);
  tw_front_run *run;
  int ran = 0;
  while ((run = tw_front_runs_suggest(runs, &error)) != NULL) {
    int64_t level = 0;
    CHECK(tw_configuration_integer(tw_front_run_configuration(run), "level", &level, &error));
    tw_number result[] = {{"ms", 100 / (double)level}, {"rate", 1000 / (double)(level * level)}};
    if (ran == 0) { /* one that lacks a metric is asked for again */
      char trial[64];
      snprintf(trial, sizeof trial, "%s", tw_front_run_trial(run));
      CHECK(strstr(trial, "studies/from-c-front@"));
      FAILS(tw_front_run_report(run, result, 1, &error), TW_INVALID, "rate");
      run = tw_front_runs_suggest(runs, &error);
      succeed(error);
      CHECK(strcmp(trial, tw_front_run_trial(run)) == 0);
    }
    CHECK(tw_front_run_report(run, result, 2, &error));
    ran++;
  }
  succeed(error);
  CHECK(ran == 6);
  tw_front *found = tw_front_runs_found(runs, &error);
  succeed(error);
  CHECK(strstr(tw_front_json(found), "\"maximised\":[\"rate\"],\"runs\":6"));
  tw_front_free(found);
  tw_front_runs_free(runs);
  /* Goes on, with one that is given back and one that cannot be. */
  runs = tw_client_front_runs(client, "from-c-front", spec, metrics, 2, 2, &error);
  succeed(error);
  tw_front_run_free(tw_front_runs_suggest(runs, &error));
  CHECK(tw_front_run_infeasible(tw_front_runs_suggest(runs, &error), "out of memory", &error));
  CHECK(tw_front_run_failed(tw_front_runs_suggest(runs, &error), "the lamp went out", &error));
  CHECK(!tw_front_runs_suggest(runs, &error));
  succeed(error);
  tw_front_runs_free(runs);
  FAILS(tw_client_front_runs(client, "from-c-front", spec, NULL, 0, 2, &error), TW_INVALID, "list of metrics is NULL");
  tw_spec_minimise(spec, "ms", 1);
  FAILS(tw_client_front_runs(client, "from-c-front", spec, metrics, 2, 2, &error), TW_INVALID,
        "an objective and an indicator of its own");
  tw_spec_free(spec);
}

static void trials(const tw_client *client) {
  tw_error *error = NULL;
  tw_study *study = opened(client, "from-c", new_spec());
  tw_number input[] = {{"triangles", 1000}};
  double best = 1e9, cost;
  int each, missed = 0;
  for (each = 0; each < 60; each++) {
    tw_suggestion *suggestion = tw_study_suggest(study, input, 1, &error);
    succeed(error);
    if (tw_suggestion_source(suggestion) != TW_DAEMON && missed++ < 100) { /* a slow machine loads the study still */
      CHECK(tw_suggestion_problem(suggestion));
      tw_suggestion_free(suggestion);
      nanosleep(&(struct timespec){0, 200000000}, NULL);
      each--;
      continue;
    }
    CHECK(tw_suggestion_source(suggestion) == TW_DAEMON && !tw_suggestion_problem(suggestion));
    CHECK(strstr(tw_suggestion_trial(suggestion), "studies/from-c@") && tw_suggestion_reason(suggestion)[0]);
    const tw_configuration *configuration = tw_suggestion_configuration(suggestion);
    const char *split = tw_configuration_text(configuration, "split", &error);
    succeed(error);
    CHECK(tw_configuration_has(configuration, "cost") == (strcmp(split, "sah") == 0));
    FAILS(tw_configuration_integer(configuration, "split", NULL, &error), TW_NO_SUCH_VALUE, "no integer named `split`");
    tw_number result[] = {{"render_ms", render(configuration)}};
    best = fmin(best, result[0].value);
    CHECK(tw_suggestion_report(suggestion, result, 1, &error));
  }
  /* One of our own, one given back, one that cannot be, one aborted. */
  tw_suggestion *own = tw_study_trial_of(
      study, input, 1, "{\"leaf\":3,\"block\":24,\"split\":\"sah\",\"compact\":false,\"cost\":1.0,\"budget\":1.2,\"tile\":64}", &error);
  succeed(error);
  CHECK(render(tw_suggestion_configuration(own)) == 5);
  tw_number result[] = {{"render_ms", 5}};
  CHECK(tw_suggestion_report(own, result, 1, &error));
  FAILS(tw_study_trial_of(study, input, 1, "{]", &error), TW_INVALID, "no JSON");
  FAILS(tw_study_set_start(study, "{\"leaf\":3}", &error), TW_INVALID, "start");
  CHECK(tw_study_set_start(study, NULL, &error));
  tw_suggestion_free(tw_study_suggest(study, input, 1, NULL));
  tw_number bad[] = {{"render_ms", NAN}};
  FAILS(tw_suggestion_report(tw_study_suggest(study, input, 1, NULL), bad, 1, &error), TW_INVALID, "render_ms");
  CHECK(tw_suggestion_aborted(tw_study_suggest(study, input, 1, NULL), 50, &error));
  CHECK(tw_suggestion_infeasible(tw_study_suggest(study, input, 1, NULL), "out of memory", &error));
  CHECK(tw_suggestion_failed(tw_study_suggest(study, input, 1, NULL), "the lamp went out", &error));
  CHECK(tw_client_flush(client, 20000, &error));
  CHECK(tw_client_count(client, TW_COUNT_ACKNOWLEDGED) >= 60 && tw_client_count(client, TW_COUNT_ABANDONED) >= 2);
  tw_configuration *found = tw_study_best(study, input, 1, &cost, &error);
  succeed(error);
  CHECK(cost >= 5 && cost <= 10 && strstr(tw_configuration_json(found), "\"leaf\":"));
  CHECK(tw_study_value(study, cost) == cost && isnan(tw_study_value(NULL, cost)));
  tw_configuration_free(found);
  tw_standing standing;
  found = tw_study_best_standing(study, input, 1, &cost, &standing, &error);
  succeed(error);
  CHECK(cost >= 5 && standing.cost_low <= standing.cost && standing.cost <= standing.cost_high);
  CHECK(standing.gain >= 0 && standing.gain_low <= standing.gain && standing.gain <= standing.gain_high);
  CHECK(standing.stage >= TW_STAGE_OFF && standing.stage <= TW_STAGE_NOTHING_BETTER);
  CHECK(standing.measurements >= 1 && standing.default_cost > 0 && strstr(standing.trial, "studies/from-c"));
  CHECK(standing.status[0] && strstr(standing.verdict, "default"));
  tw_configuration_free(found);
  FAILS(tw_study_best_standing(study, input, 1, NULL, NULL, &error), TW_INVALID, "room for the result is NULL");
  found = tw_study_predict(study, input, 1, &cost, &error);
  succeed(error);
  CHECK(render(found) <= 10);
  CHECK(tw_configuration_reason(found)[0] && !tw_configuration_reason(NULL)[0]);
  tw_configuration_free(found);
  /* Wrong indicators are reported and do not stop a frame. */
  tw_number wrong[] = {{"triangle", 1000}};
  tw_suggestion *suggestion = tw_study_suggest(study, wrong, 1, &error);
  succeed(error);
  CHECK(strstr(tw_suggestion_problem(suggestion), "triangle"));
  tw_suggestion_free(suggestion);
  tw_study_free(study);
}

typedef struct worker {
  pthread_t thread;
  pthread_barrier_t *frame;
  const tw_client *client;
  const tw_study *study;
  int number;
  char trial[64];
} worker;

static worker workers[4];

/* All threads are in one scene, and share client and study: each has a trial of its own all the same. */
static void *work(void *argument) {
  worker *self = argument;
  tw_error *error = NULL;
  tw_tuner *tuner = tw_tuner_new(self->study, &error);
  succeed(error);
  tw_number input[] = {{"triangles", 5000}};
  int each, other;
  for (each = 0; each < 25; each++) {
    tw_suggestion *suggestion = tw_tuner_next(tuner, input, 1, &error);
    succeed(error);
    snprintf(self->trial, sizeof self->trial, "%s", tw_suggestion_trial(suggestion));
    pthread_barrier_wait(self->frame);
    for (other = 0; other < self->number; other++)
      CHECK(self->trial[0] == 0 || strcmp(self->trial, workers[other].trial) != 0);
    pthread_barrier_wait(self->frame);
    tw_number result[] = {{"render_ms", render(tw_suggestion_configuration(suggestion))}};
    CHECK(tw_tuner_finish(tuner, suggestion, result, 1, &error));
    CHECK(tw_client_count(self->client, TW_COUNT_DROPPED) == 0);
  }
  tw_tuner_free(tuner);
  return NULL;
}

/* A loop keeps a trial for its frames. One frame is not reported as the trial. */
static void episodes(const tw_client *client) {
  tw_error *error = NULL;
  tw_spec *spec = tw_spec_new();
  tw_spec_integer(spec, "leaf", 1, 32, 8, TW_LOG);
  tw_spec_minimise(spec, "render_ms", 1);
  tw_spec_episode_frames(spec, 3);
  tw_study *study = opened(client, "from-c-episodes", spec);
  tw_tuner *tuner = tw_tuner_new(study, &error);
  succeed(error);
  char trial[64] = "";
  int frame;
  for (frame = 0; frame < 6; frame++) {
    tw_suggestion *suggestion = tw_tuner_next(tuner, NULL, 0, &error);
    succeed(error);
    CHECK(tw_suggestion_source(suggestion) == TW_DAEMON);
    CHECK((strcmp(trial, tw_suggestion_trial(suggestion)) == 0) == (frame % 3 > 0));
    snprintf(trial, sizeof trial, "%s", tw_suggestion_trial(suggestion));
    tw_number result[] = {{"render_ms", 1 + frame % 3}};
    CHECK(tw_tuner_finish(tuner, suggestion, result, 1, &error));
  }
  tw_suggestion *first = tw_tuner_next(tuner, NULL, 0, &error);
  succeed(error);
  tw_number early[] = {{"render_ms", 1}};
  FAILS(tw_suggestion_report(first, early, 1, &error), TW_INVALID, "its trial has more frames");
  CHECK(tw_client_flush(client, 20000, &error));
  double cost = 0;
  tw_configuration *best = tw_study_best(study, NULL, 0, &cost, &error);
  succeed(error);
  CHECK(cost > 1.99 && cost < 2.01);
  tw_configuration_free(best);
  tw_tuner_free(tuner);
  tw_study_free(study);
}

static void threads(const tw_client *client) {
  tw_error *error = NULL;
  tw_study *study = opened(client, "threads", new_spec());
  uint64_t before = tw_client_count(client, TW_COUNT_ACKNOWLEDGED) + tw_client_count(client, TW_COUNT_UNREPORTED);
  pthread_barrier_t frame;
  CHECK(pthread_barrier_init(&frame, NULL, 4) == 0);
  int each;
  for (each = 0; each < 4; each++) {
    worker self = {.frame = &frame, .client = client, .study = study, .number = each};
    workers[each] = self;
    CHECK(pthread_create(&workers[each].thread, NULL, work, &workers[each]) == 0);
  }
  for (each = 0; each < 4; each++) CHECK(pthread_join(workers[each].thread, NULL) == 0);
  CHECK(tw_client_flush(client, 20000, &error));
  uint64_t after = tw_client_count(client, TW_COUNT_ACKNOWLEDGED) + tw_client_count(client, TW_COUNT_UNREPORTED);
  CHECK(after - before == 100);
  tw_study_free(study);
  CHECK(tw_client_delete_study(client, "threads", &error));
}

/* In the child of a fork a study goes on as another worker; what the parent runs is none of the child's business. */
static void forked(const tw_client *client) {
  tw_error *error = NULL;
  tw_study *study = opened(client, "forked", new_spec());
  tw_number input[] = {{"triangles", 1000}};
  tw_number result[] = {{"render_ms", 6}};
  tw_suggestion *ours = tw_study_suggest(study, input, 1, &error);
  succeed(error);
  fflush(stdout);
  pid_t child = fork();
  CHECK(child >= 0);
  if (child == 0) {
    tw_suggestion *theirs = tw_study_suggest(study, input, 1, &error);
    succeed(error);
    CHECK(tw_suggestion_source(theirs) == TW_DAEMON && tw_suggestion_source(ours) == TW_DAEMON);
    CHECK(strcmp(tw_suggestion_trial(theirs), tw_suggestion_trial(ours)) != 0);
    CHECK(tw_suggestion_report(theirs, result, 1, &error));
    FAILS(tw_suggestion_report(ours, result, 1, &error), TW_INVALID, "forked");
    CHECK(tw_client_flush(client, 20000, NULL) && tw_client_count(client, TW_COUNT_ACKNOWLEDGED) == 1);
    /* A check for leaks has nothing to look at here: what the parent's threads had is lost in a child. */
    execlp("true", "true", (char *)NULL);
    _exit(1);
  }
  int status = 1;
  CHECK(waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
  CHECK(tw_suggestion_report(ours, result, 1, &error));
  CHECK(tw_client_flush(client, 20000, &error));
  tw_study_free(study);
  CHECK(tw_client_delete_study(client, "forked", &error));
}

/* Work that takes longer than its lease renews it, as long as the daemon knows the trial. */
static void renewed(const tw_client *client) {
  tw_error *error = NULL;
  tw_study *study = opened(client, "renewed", new_spec());
  tw_suggestion *suggestion = tw_study_suggest(study, (tw_number[]){{"triangles", 1000}}, 1, &error);
  succeed(error);
  CHECK(tw_suggestion_source(suggestion) == TW_DAEMON);
  CHECK(tw_client_extend_lease(client, suggestion, &error) && tw_client_extend_lease(client, suggestion, &error));
  CHECK(tw_client_delete_study(client, "renewed", &error));
  CHECK(!tw_client_extend_lease(client, suggestion, &error));
  CHECK(tw_error_grpc_code(error) == 5);
  expect(error, TW_REFUSED, "renewed");
  tw_suggestion_free(suggestion);
  tw_study_free(study);
}

/* In a child of a process with threads the address sanitiser's allocator may wait for ever for a lock that another thread
 * held at the fork. */
#ifdef __SANITIZE_ADDRESS__
#define FORKS_BESIDE_THREADS 0
#else
#define FORKS_BESIDE_THREADS 1
#endif

static volatile int loops_on = 1;

static void *frames(void *argument) {
  tw_number input[] = {{"triangles", 1000}};
  tw_number result[] = {{"render_ms", 6}};
  while (loops_on) {
    tw_suggestion *suggestion = tw_tuner_next(argument, input, 1, NULL);
    CHECK(suggestion && tw_tuner_finish(argument, suggestion, result, 1, NULL));
  }
  return NULL;
}

/* Whatever another thread does with a frame loop when the process is forked, the child's goes on. */
static void forked_in_a_frame(const tw_client *client) {
  tw_error *error = NULL;
  tw_study *study = opened(client, "forked", new_spec());
  tw_tuner *tuner = tw_tuner_new(study, &error);
  succeed(error);
  pthread_t thread;
  CHECK(pthread_create(&thread, NULL, frames, tuner) == 0);
  tw_number input[] = {{"triangles", 1000}};
  int each;
  for (each = 0; each < 10; each++) {
    fflush(stdout);
    pid_t child = fork();
    CHECK(child >= 0);
    if (child == 0) {
      alarm(60);
      tw_suggestion *theirs = tw_tuner_next(tuner, input, 1, &error);
      succeed(error);
      CHECK(tw_suggestion_source(theirs) == TW_DAEMON);
      tw_suggestion_free(theirs);
      CHECK(tw_client_flush(client, 20000, NULL));
      execlp("true", "true", (char *)NULL);
      _exit(1);
    }
    int status = 1;
    CHECK(waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }
  loops_on = 0;
  CHECK(pthread_join(thread, NULL) == 0);
  tw_tuner_free(tuner);
  CHECK(tw_client_flush(client, 20000, &error));
  tw_study_free(study);
  CHECK(tw_client_delete_study(client, "forked", &error));
}

static void scene(void) {
  /* The halves of a 3 by 4 rectangle, the second twice, in a buffer with gaps and turned by a matrix; one that names a vertex
   * that is not there. */
  const float corners[] = {0, 0, 0, 3, 0, 0, 0, 4, 0};
  const float spaced[] = {0, 0, 0, 9, 3, 0, 0, 9, 0, 4, 0, 9};
  const uint32_t triangle[] = {0, 1, 2}, beyond[] = {0, 1, 2, 7, 0, 1, 2, 0, 0, 9, 0, 0};
  const float half_turn[] = {-1, 0, 0, 0, -1, 0, 0, 0, 1, 3, 4, 0};
  const tw_mesh meshes[] = {
      {.vertices = corners, .vertex_count = 3, .indices = triangle, .triangle_count = 1, .diffuse_share = 1},
      {.vertices = spaced, .vertex_stride = 16, .vertex_count = 3, .indices = beyond, .index_stride = 16,
       .triangle_count = 3, .transform = half_turn, .diffuse_share = 0.5, .emits = true}};
  const tw_camera camera = {{1.5f, 2, 5}, {0, 0, 0}, 40};
  tw_error *error = NULL;
  tw_scene *scene = tw_scene_new(meshes, 2, 1, &error);
  succeed(error);
  tw_number numbers[TW_SCENE_INDICATORS];
  CHECK(tw_scene_indicators(scene, &camera, numbers, &error));
  const struct {
    const char *name;
    double value;
  } expected[] = {{"mesh_count", 2}, {"triangle_count", 3}, {"light_count", 2}, {"camera_z", 10}, {"extent", 5},
                  {"total_area", 18. / 25}, {"light_area", 12. / 25}, {"diffuse_ratio", 2. / 3}, {"vertical_fov_deg", 40}};
  size_t each, other, found = 0;
  for (each = 0; each < sizeof expected / sizeof expected[0]; each++)
    for (other = 0; other < TW_SCENE_INDICATORS; other++)
      if (strcmp(numbers[other].name, expected[each].name) == 0) {
        CHECK(fabs(numbers[other].value - expected[each].value) < 1e-6);
        found++;
      }
  CHECK(found == sizeof expected / sizeof expected[0]);
  tw_scene_free(scene);
  tw_mesh bad = meshes[0];
  bad.vertex_stride = 4;
  FAILS(tw_scene_new(&bad, 1, 0, &error), TW_INVALID, "vertex buffer");
}

int main(int count, char **arguments) {
  CHECK(count == 2);
  tw_error *error = NULL;
  tw_options *options = tw_options_new();
  tw_options_client_id(options, "c-test");
  tw_options_deadline_ms(options, 20000);
  tw_options_call_deadline_ms(options, 20000);
  tw_options_software(options, "sdk.c", "1");
  tw_client *client = tw_client_connect(arguments[1], options, &error);
  tw_options_free(options);
  succeed(error);
  double ms = -1;
  CHECK(tw_client_ping(client, &ms, &error) && ms >= 0);
  without_handles();
  mistakes(client);
  without_daemon();
  maximised(client);
  changed_space(client);
  fronts(client);
  trials(client);
  episodes(client);
  threads(client);
  forked(client);
  if (FORKS_BESIDE_THREADS) forked_in_a_frame(client);
  renewed(client);
  scene();
  tw_client_free(client);
  puts("ok");
  return 0;
}
