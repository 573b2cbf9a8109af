#include "narrow/goal.h"

bool goal_is_asked(const Goal *goal, Times at) {
    double difference = at.v - goal->weight * at.u;
    if (!goal->is_factor) return difference >= goal->least && difference <= goal->most;
    return at.v >= goal->least * at.u && at.v <= goal->most * at.u;
}

void goal_cut(const Goal *goal, Part *part, double sign, double value) {
    if (goal->is_factor) part_cut(part, value, -sign, -goal->pad_s);
    else part_cut(part, sign * goal->weight, -sign, value);
}

double goal_exactly(const Goal *goal, double sign, Times at) {
    Goal exact = *goal;
    exact.pad_s = 0.0;
    return goal_value(&exact, sign, at);
}

void goal_cut_asked(const Goal *goal, Part *part) {
    goal_cut(goal, part, 1.0, goal->least), goal_cut(goal, part, -1.0, -goal->most);
}

double goal_highest(const Goal *goal, const Part *part, double sign, Times *at) {
    double highest = -INFINITY;
    for (int i = 0; i < part->count; i++) {
        double value = goal_value(goal, sign, part->corner[i]);
        if (value > highest) highest = value, *at = part->corner[i];
    }
    return highest;
}
