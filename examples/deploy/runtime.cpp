// Runs a surefoot policy at 500 Hz in C++17 without any library, after docs/policy-file.md.
//
//   g++ -O2 -std=c++17 runtime.cpp -o runtime
//   ./runtime POLICY.txt VECTORS.csv [--fast]
//
// POLICY.txt is written by flatten.py, VECTORS.csv by `surefoot export`. The states of the golden run stand in the
// place of a robot's; every number is compared with the run's, and latency and jitter are printed.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

using Vector = std::vector<double>;
using Clock = std::chrono::steady_clock;

[[noreturn]] void fail(const std::string& message) {
    std::fprintf(stderr, "%s\n", message.c_str());
    std::exit(2);
}

struct Layer {
    size_t outputs, inputs;
    int follows;  // 0 nothing, 1 tanh, 2 ReLU, 3 ELU
    std::vector<float> weight, bias;
};

// A policy as flatten.py wrote it.
struct Policy {
    std::map<std::string, Vector> numbers;
    std::vector<Layer> layers;

    explicit Policy(const std::string& path) {
        std::ifstream file(path);
        if (!file) fail("cannot read " + path);
        std::string name;
        size_t count;
        while (file >> name >> count) {
            Vector values(count);
            for (double& value : values)
                if (!(file >> value)) fail(path + ": " + name + " has fewer numbers than it says");
            if (name.rfind("layer_", 0) == 0)
                add_layer(values);
            else
                numbers[name] = values;
        }
        if (layers.empty()) fail(path + " has no layers");
    }

    const Vector& at(const std::string& name) const {
        auto found = numbers.find(name);
        if (found == numbers.end()) fail("the policy has no " + name);
        return found->second;
    }

    // The network; its weights and inputs are in single precision.
    Vector action(const Vector& inputs) const {
        Vector value(inputs.size());
        for (size_t i = 0; i < inputs.size(); ++i) value[i] = float(inputs[i]);
        for (const Layer& layer : layers) {
            Vector next(layer.bias.begin(), layer.bias.end());
            for (size_t row = 0; row < layer.outputs; ++row) {
                const float* weight = &layer.weight[row * layer.inputs];
                for (size_t column = 0; column < layer.inputs; ++column) next[row] += weight[column] * value[column];
                if (layer.follows == 1) next[row] = std::tanh(next[row]);
                if (layer.follows == 2) next[row] = std::max(next[row], 0.0);
                if (layer.follows == 3) next[row] = next[row] > 0.0 ? next[row] : std::expm1(next[row]);
            }
            value = next;
        }
        return value;
    }

   private:
    void add_layer(const Vector& values) {
        Layer layer{size_t(values.at(0)), size_t(values.at(1)), int(values.at(2)), {}, {}};
        if (values.size() != 3 + layer.outputs * (layer.inputs + 1)) fail("a layer has another size than it says");
        auto weights_end = values.begin() + 3 + layer.outputs * layer.inputs;
        layer.weight.assign(values.begin() + 3, weights_end);
        layer.bias.assign(weights_end, values.end());
        layers.push_back(layer);
    }
};

// What a robot's estimators say, in the world frame and in SI units; the columns of a golden run.
using State = std::map<std::string, Vector>;

void append(Vector& to, const Vector& values) { to.insert(to.end(), values.begin(), values.end()); }

// Observation, filter, path and joint law about a policy.
struct Loop {
    const Policy& policy;
    Vector observation, filtered, action, target, before, goal;
    std::deque<Vector> observed, acted;
    long number = 0;

    explicit Loop(const Policy& policy) : policy(policy) {
        double warped = std::tan(M_PI * policy.at("filter")[0] / policy.at("filter")[1]);
        b = warped / (1.0 + warped);
        a = (warped - 1.0) / (warped + 1.0);
    }

    void start(const State& state, const Vector& held) {
        observation = filtered = observe(state);
        target = before = goal = held;
        observed.assign(size_t(policy.at("past")[0]), filtered);
        acted.assign(size_t(policy.at("past")[1]), Vector(held.size(), 0.0));
    }

    Vector tick(const State& state) {
        long ticks = long(policy.at("ticks")[0]), place = number++ % ticks;
        if (place == 0) decide();
        double u = double(place + 1) / double(ticks), share = u * u * (3.0 - 2.0 * u);
        for (size_t i = 0; i < target.size(); ++i) target[i] = before[i] + share * (goal[i] - before[i]);
        Vector now = observe(state);
        for (size_t i = 0; i < now.size(); ++i) filtered[i] = b * (now[i] + observation[i]) - a * filtered[i];
        observation = now;
        return torque(state.at("joint_position"), state.at("joint_velocity"));
    }

   private:
    double a, b;

    void decide() {
        Vector inputs = filtered;
        for (const Vector& past : observed) append(inputs, past);
        for (const Vector& past : acted) append(inputs, past);
        if (inputs.size() != policy.layers[0].inputs) fail("the network takes another number of inputs");
        before = goal;
        action = policy.action(inputs);
        Vector clipped(action);
        for (size_t i = 0; i < action.size(); ++i) {
            clipped[i] = std::clamp(action[i], -1.0, 1.0);
            double wanted = policy.at("nominal_pose")[i] + policy.at("action_scale")[0] * clipped[i];
            goal[i] = std::clamp(wanted, policy.at("lower")[i], policy.at("upper")[i]);
        }
        remember(observed, filtered);
        remember(acted, clipped);
    }

    static void remember(std::deque<Vector>& past, const Vector& newest) {
        if (past.empty()) return;
        past.pop_back();
        past.push_front(newest);
    }

    Vector torque(const Vector& position, const Vector& velocity) const {
        Vector found(position.size());
        for (size_t i = 0; i < found.size(); ++i) {
            double limit = policy.at("torque_limit")[i], stall = policy.at("stall")[0] * limit;
            double share = velocity[i] / policy.at("velocity_limit")[i];
            double wanted = policy.at("stiffness")[i] * (target[i] - position[i]) - policy.at("damping")[i] * velocity[i];
            found[i] = std::clamp(std::clamp(wanted, stall * (-1.0 - share), stall * (1.0 - share)), -limit, limit);
        }
        return found;
    }

    // The order is that of docs/policy-file.md, the same for every policy.
    Vector observe(const State& state) const {
        const Vector& turn = state.at("root_orientation");
        double w = turn[0], x = turn[1], y = turn[2], z = turn[3];
        double cosine = 1.0 - 2.0 * (y * y + z * z), sine = 2.0 * (x * y + w * z), length = std::hypot(cosine, sine);
        cosine /= length, sine /= length;
        auto in_heading = [&](const Vector& v) {
            return Vector{cosine * v[0] + sine * v[1], cosine * v[1] - sine * v[0], v[2]};
        };
        auto from_root = [&](const Vector& v) {
            const Vector& root = state.at("root_position");
            return in_heading({v[0] - root[0], v[1] - root[1], v[2] - root[2]});
        };
        Vector found = state.at("joint_position");
        for (size_t i = 0; i < policy.at("velocity_limit").size(); ++i)
            found.push_back(state.at("joint_velocity")[i] / policy.at("velocity_limit")[i]);
        append(found, in_heading(state.at("root_velocity")));
        append(found, in_heading(state.at("root_angular_velocity")));
        found.push_back(std::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)));
        found.push_back(std::asin(std::clamp(2.0 * (w * y - z * x), -1.0, 1.0)));
        append(found, in_heading(state.at("com_velocity")));
        append(found, from_root(state.at("com_position")));
        for (double force : state.at("foot_force")) found.push_back(force / policy.at("foot_force")[0]);
        append(found, from_root(state.at("torso_position")));
        append(found, from_root(state.at("left_sole_position")));
        append(found, from_root(state.at("right_sole_position")));
        return found;
    }
};

// The rows of a golden run, its columns by the first word of their names.
std::vector<State> read_vectors(const std::string& path) {
    std::ifstream file(path);
    if (!file) fail("cannot read " + path);
    std::string line, cell;
    std::vector<std::string> words;
    std::getline(file, line);
    for (std::stringstream header(line); std::getline(header, cell, ',');) words.push_back(cell.substr(0, cell.find('.')));
    std::vector<State> rows;
    while (std::getline(file, line)) {
        State row;
        std::stringstream cells(line);
        for (const std::string& word : words) {
            if (!std::getline(cells, cell, ',')) fail(path + " has a short row");
            row[word].push_back(std::strtod(cell.c_str(), nullptr));
        }
        rows.push_back(row);
    }
    if (rows.size() < 2) fail(path + " has no rows");
    return rows;
}

void print_times(const char* word, Vector times) {
    std::sort(times.begin(), times.end());
    size_t last = times.size() - 1;
    std::printf("%s of a tick: median %.0f us, 99 %% %.0f us, largest %.0f us\n", word, 1e6 * times[last / 2],
                1e6 * times[last * 99 / 100], 1e6 * times[last]);
}

int main(int count, char** words) {
    bool fast = count == 4 && !std::strcmp(words[3], "--fast");
    if (count != 3 && !fast) fail("usage: runtime POLICY.txt VECTORS.csv [--fast]");
    Policy policy(words[1]);
    std::vector<State> rows = read_vectors(words[2]);
    Loop loop(policy);
    loop.start(rows[0], rows[0].at("target"));
    const std::map<std::string, double> allowed = {
        {"observation", 1e-9}, {"filtered", 1e-9}, {"action", 2e-4}, {"target", 2e-4}, {"torque", 0.4}};
    std::map<std::string, double> worst;
    Vector latency, late;
    const auto period = std::chrono::duration<double>(1.0 / policy.at("filter")[1]);
    auto due = Clock::now();
    for (size_t row = 1; row < rows.size(); ++row) {
        due += std::chrono::duration_cast<Clock::duration>(period);
        if (!fast) std::this_thread::sleep_until(due);
        auto began = Clock::now();
        Vector torque = loop.tick(rows[row]);
        latency.push_back(std::chrono::duration<double>(Clock::now() - began).count());
        late.push_back(fast ? 0.0 : std::chrono::duration<double>(began - due).count());
        const std::map<std::string, const Vector*> found = {{"observation", &loop.observation},
                                                            {"filtered", &loop.filtered},
                                                            {"action", &loop.action},
                                                            {"target", &loop.target},
                                                            {"torque", &torque}};
        for (const auto& [word, values] : found) {
            if (values->size() != rows[row].at(word).size()) fail("another number of " + word + "s than the run has");
            for (size_t i = 0; i < values->size(); ++i) {
                double difference = std::abs((*values)[i] - rows[row].at(word)[i]);
                if (!(difference <= worst[word])) worst[word] = difference;
            }
        }
    }
    bool good = true;
    for (const auto& [word, limit] : allowed) {
        std::printf("%s: largest difference %.1e, allowed %.0e\n", word.c_str(), worst[word], limit);
        good = good && worst[word] <= limit;
    }
    print_times("latency", latency);
    print_times("jitter", late);
    return good ? 0 : 1;
}
