/* Round trips from C: `latency URL COUNT`. See run.sh. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "treewright.h"

static double now_us(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec * 1e6 + (double)now.tv_nsec / 1e3;
}

static int by_size(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static void need(tw_error *error) {
  if (error) {
    fprintf(stderr, "%s\n", tw_error_message(error));
    exit(1);
  }
}

int main(int given, char **arguments) {
  int count = given > 2 ? atoi(arguments[2]) : 1000, each;
  double *predict = malloc(sizeof(double) * (size_t)count), *trial = malloc(sizeof(double) * (size_t)count);
  tw_error *error = NULL;
  tw_options *options = tw_options_new();
  tw_options_deadline_ms(options, 5000);
  tw_client *client = tw_client_connect(arguments[1], options, &error);
  need(error);
  tw_spec *spec = tw_spec_new();
  tw_spec_integer(spec, "leaf", 1, 32, 8, TW_LOG);
  tw_spec_minimise(spec, "ms", 1);
  tw_study *study = tw_client_study(client, "latency-c", spec, &error);
  need(error);
  for (each = -50; each < count; each++) {
    double start = now_us(), middle;
    tw_configuration_free(tw_study_predict(study, NULL, 0, NULL, &error));
    need(error);
    middle = now_us();
    tw_suggestion *suggestion = tw_study_suggest(study, NULL, 0, &error);
    need(error);
    if (each >= 0) {
      predict[each] = middle - start;
      trial[each] = now_us() - middle;
    }
    tw_number result[] = {{"ms", 1}};
    tw_suggestion_report(suggestion, result, 1, &error);
    need(error);
    tw_client_flush(client, 5000, &error);
    need(error);
  }
  qsort(predict, (size_t)count, sizeof(double), by_size);
  qsort(trial, (size_t)count, sizeof(double), by_size);
  printf("{\"from\":\"C\",\"predict_us\":[%.0f,%.0f],\"suggest_us\":[%.0f,%.0f]}\n", predict[count / 2],
         predict[count * 99 / 100], trial[count / 2], trial[count * 99 / 100]);
  return 0;
}
