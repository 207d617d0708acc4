// SPDX-License-Identifier: BSD-3-Clause
//
// What the programs share in reading their command lines, on Boost.Program_options: CLI11 is not in Ubuntu 20.04.
#pragma once

#include <exception>
#include <filesystem>
#include <iostream>
#include <limits>
#include <list>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <boost/lexical_cast/try_lexical_convert.hpp>
#include <boost/program_options.hpp>

namespace devo {

namespace po = boost::program_options;

/// Value of an option that may be given several times and takes all words up to the next option.
template <typename T>
po::typed_value<std::vector<T>>* Several(std::vector<T>* values) {
  return po::value(values)->composing()->multitoken();
}

/// Has --help show the value as it stands before the command line is read.
template <typename T>
po::typed_value<T>* WithDefault(po::typed_value<T>* option, const T& value) {
  std::ostringstream text;  // Boost's own would be 0.29999999999999999
  text << value;
  return option->default_value(value, text.str());
}

template <typename T>
po::typed_value<T>* Shown(T* value) {
  return WithDefault(po::value(value), *value);
}

/// A number from `min` to `max`. Boost's own let NaN through, and have no end, so that a time overflows as nanoseconds.
template <typename T>
class NumberValue : public po::typed_value<T> {
 public:
  NumberValue(T* value, double min, double max) : po::typed_value<T>(value), min_(min), max_(max) {
    this->value_name("NUMBER");
  }
  void xparse(boost::any& store, const std::vector<std::string>& words) const override {
    po::validators::check_first_occurrence(store);
    const std::string& word = po::validators::get_single_string(words);
    double number = 0;
    const bool is_number = boost::conversion::try_lexical_convert(word, number) && number >= min_ && number <= max_;
    if (!is_number || static_cast<double>(static_cast<T>(number)) != number) {
      std::ostringstream error;
      error << "option '%canonical_option%' is '" << word << "', expected a" << (std::is_integral_v<T> ? " whole" : "")
            << " number from " << min_ << " to " << max_;
      throw po::error_with_option_name(error.str());
    }
    store = static_cast<T>(number);
  }

 private:
  double min_, max_;
};

template <typename T>
po::typed_value<T>* NumberIn(T* value, double min, double max) {
  return new NumberValue<T>(value, min, max);  // owned by the option that it is given to, as all of Boost's
}

template <typename T>
po::typed_value<T>* ShownNumberIn(T* value, double min, double max) {
  return WithDefault(NumberIn(value, min, max), *value);
}

class CommandLine {
 public:
  /// `usage`: what is to follow the program's name; `footer`: below the options in --help.
  CommandLine(std::string usage, std::string description, std::string footer = "")
      : usage_(std::move(usage)), description_(std::move(description)), footer_(std::move(footer)) {
    BeginGroup("Options");
    groups_.back().add_options()("help,h", "print this and exit");
  }
  /// Options added from here on stand below `heading` in --help.
  void BeginGroup(const std::string& heading) { groups_.emplace_back(heading, kWidth); }
  /// Takes `value`, as Boost does.
  void Add(const char* option, const po::value_semantic* value, const char* help) {
    groups_.back().add_options()(option, value, help);
  }
  void AddFlag(const char* option, bool* value, const char* help) { Add(option, po::bool_switch(value), help); }
  /// The next `count` words that belong to no option (-1: all of them), which `usage` should explain.
  void AddWords(const char* name, const po::value_semantic* value, int count) {
    words_.add_options()(name, value);
    positions_.add(name, count);
  }

  /// Where the program is to end, its exit status: 0 after --help, 2 after an error, which is on standard error.
  std::optional<int> Read(int argc, char** argv) {
    const std::string program = std::filesystem::path(argv[0]).filename().string();
    try {
      Store(argc, argv);
      if (values_.count("help") > 0) {
        std::cout << description_ << "\nUsage: " << program << " " << usage_ << "\n";
        for (const po::options_description& group : groups_) std::cout << "\n" << group;
        std::cout << footer_;
        return 0;
      }
      po::notify(values_);
    } catch (const std::exception& e) {
      std::cerr << program << ": " << e.what() << " (" << program << " --help tells all options)\n";
      return 2;
    }
    return std::nullopt;
  }
  /// Whether the user gave it.
  bool Has(const std::string& option) const { return values_.count(option) > 0 && !values_[option].defaulted(); }

 private:
  void Store(int argc, char** argv) {
    po::options_description all;
    for (const po::options_description& group : groups_) all.add(group);
    const bool takes_all_words = positions_.max_total_count() == std::numeric_limits<unsigned>::max();
    words_.add_options()("stray", po::value<std::vector<std::string>>());
    if (!takes_all_words) positions_.add("stray", -1);
    all.add(words_);
    const int style = po::command_line_style::unix_style & ~po::command_line_style::allow_guessing;
    const auto parsed = po::command_line_parser(argc, argv).options(all).positional(positions_).style(style).run();
    for (const po::option& option : parsed.options) {
      // Boost takes the next option for the value of one that has none.
      if (!option.value.empty() && option.value.front().rfind("--", 0) == 0) {
        throw std::invalid_argument("option '--" + option.string_key + "' has no value before '" +
                                    option.value.front() + "'");
      }
      if (option.string_key == "stray") throw std::invalid_argument("'" + option.value.front() + "' is no option");
    }
    po::store(parsed, values_);
  }

  static constexpr unsigned kWidth = 110;  // letters
  std::string usage_, description_, footer_;
  std::list<po::options_description> groups_;
  po::options_description words_;
  po::positional_options_description positions_;
  po::variables_map values_;
};

}  // namespace devo
