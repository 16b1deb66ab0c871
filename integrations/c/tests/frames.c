/* Runs a frame for each size against a running daemon: `frames URL SIZE...`. Prints the size, leaf and window of
 * each, and whether it ran. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "treewright.h"

static void succeed(tw_error *error) {
  if (error) {
    fprintf(stderr, "failed: %s\n", tw_error_message(error));
    exit(1);
  }
}

static tw_study *opened(const tw_client *client) {
  tw_error *error = NULL;
  tw_spec *spec = tw_spec_new();
  tw_spec_integer(spec, "leaf", 1, 32, 8, TW_LOG);
  tw_spec_integer(spec, "window", 1, 15, 8, TW_LINEAR);
  tw_spec_indicator(spec, "size", 0, 100, TW_LINEAR);
  tw_spec_minimise(spec, "ms", 1);
  tw_spec_policy(spec, "epsilon", "0.8");
  tw_spec_policy(spec, "confirm_rounds", "0");
  tw_study *study = tw_client_study(client, "frozen", spec, &error);
  succeed(error);
  tw_spec_free(spec);
  return study;
}

/* The daemon's answer. A slow machine may load the study still. */
static tw_suggestion *suggested(const tw_study *study, const tw_number *input) {
  tw_error *error = NULL;
  int missed;
  for (missed = 0; missed < 100; missed++) {
    tw_suggestion *suggestion = tw_study_suggest(study, input, 1, &error);
    succeed(error);
    if (tw_suggestion_source(suggestion) == TW_DAEMON)
      return suggestion;
    tw_suggestion_free(suggestion);
    nanosleep(&(struct timespec){0, 200000000}, NULL);
  }
  fputs("the daemon does not answer\n", stderr);
  exit(1);
}

static void frame(const tw_study *study, double size) {
  tw_error *error = NULL;
  tw_number input[] = {{"size", size}};
  tw_suggestion *suggestion = suggested(study, input);
  const tw_configuration *configuration = tw_suggestion_configuration(suggestion);
  int64_t leaf = 0, window = 0;
  tw_configuration_integer(configuration, "leaf", &leaf, &error);
  succeed(error);
  tw_configuration_integer(configuration, "window", &window, &error);
  succeed(error);
  /* The cheapest lie just beside those that cannot be used. */
  bool ran = leaf + window <= 24;
  printf("%.0f %d %d %s\n", size, (int)leaf, (int)window, ran ? "ran" : "failed");
  if (ran) {
    tw_number result[] = {{"ms", 60.0 - (double)(leaf + window)}};
    tw_suggestion_report(suggestion, result, 1, &error);
  } else {
    tw_suggestion_infeasible(suggestion, "its output grows", &error);
  }
  succeed(error);
}

int main(int count, char **arguments) {
  tw_error *error = NULL;
  if (count < 2)
    return 2;
  tw_options *options = tw_options_new();
  tw_options_client_id(options, "c-frames");
  tw_options_deadline_ms(options, 20000);
  tw_options_call_deadline_ms(options, 20000);
  tw_client *client = tw_client_connect(arguments[1], options, &error);
  tw_options_free(options);
  succeed(error);
  tw_study *study = opened(client);
  int each;
  for (each = 2; each < count; each++)
    frame(study, atof(arguments[each]));
  tw_client_flush(client, 20000, &error);
  succeed(error);
  tw_study_free(study);
  tw_client_free(client);
  return 0;
}
