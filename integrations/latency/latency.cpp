// Round trips from C++: `latency URL COUNT`. See run.sh.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "treewright.hpp"

int main(int given, char **arguments) {
  using Clock = std::chrono::steady_clock;
  auto us = [](Clock::duration took) { return std::chrono::duration<double, std::micro>(took).count(); };
  int count = given > 2 ? std::atoi(arguments[2]) : 1000;
  tw::Client client(arguments[1], tw::Options().deadline_ms(5000));
  tw::Study study = client.study("latency-cpp", tw::Spec().integer("leaf", 1, 32, 8, TW_LOG).minimise("ms"));
  std::vector<double> predict, suggest;
  for (int each = -50; each < count; each++) {
    auto start = Clock::now();
    study.predict();
    auto middle = Clock::now();
    tw::Suggestion suggestion = study.suggest();
    auto end = Clock::now();
    if (each >= 0) predict.push_back(us(middle - start)), suggest.push_back(us(end - middle));
    suggestion.report({{"ms", 1}});
    client.flush(5000);
  }
  std::sort(predict.begin(), predict.end());
  std::sort(suggest.begin(), suggest.end());
  size_t half = predict.size() / 2, last = predict.size() * 99 / 100;
  std::printf("{\"from\":\"C++\",\"predict_us\":[%.0f,%.0f],\"suggest_us\":[%.0f,%.0f]}\n", predict[half], predict[last],
              suggest[half], suggest[last]);
}
