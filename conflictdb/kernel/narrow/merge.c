/* Merge contacts of pieces into the periods of pairs of objects, with the error bounds of their ends. */
#include <math.h>
#include <stdlib.h>

#include "narrow/instants.h"
#include "planes/earth.h"

/* A contact that is reported. */
typedef struct {
    int64_t group, row;
    Time time;
} Reported;

/* A period, and its contacts [first, end) of the order. */
typedef struct {
    Time time;
    int64_t first, end;
} Period;

static int by_group_and_time(const void *one, const void *other) {
    const Reported *a = one, *b = other;
    if (a->group != b->group) return a->group < b->group ? -1 : 1;
    if (a->time.start_us != b->time.start_us) return a->time.start_us < b->time.start_us ? -1 : 1;
    if (a->time.end_us != b->time.end_us) return a->time.end_us < b->time.end_us ? -1 : 1;
    return a->row < b->row ? -1 : a->row > b->row;
}

/* The distance to the next double, with the sign of x. */
static double spacing(double x) { return x < 0.0 ? -spacing(-x) : nextafter(x, INFINITY) - x; }

/* An instant so many whole microseconds later. */
static int64_t later(int64_t at_us, double by_us) {
    if (!(fabs(by_us) < 0x1p62)) return by_us < 0.0 ? KERNEL_MINUS_INFINITY_US : KERNEL_INFINITY_US;
    return (int64_t)((uint64_t)at_us + (uint64_t)(int64_t)by_us);
}

/* Seconds of centuries do not resolve microseconds: round outward by their spacing. */
Time instants_of(double start_s, double end_s, Time shared) {
    Time time = shared;
    if (start_s <= 0.0 && isinf(end_s)) return time;
    if (!(start_s <= 0.0)) time.start_us = later(shared.start_us, floor((start_s - 2.0 * spacing(fabs(start_s))) * 1e6));
    bool ends_before = !(end_s >= us_between(shared.start_us, shared.end_us) / 1e6);
    if (ends_before) time.end_us = later(shared.start_us, ceil((end_s + 2.0 * spacing(end_s)) * 1e6));
    if (time.end_us > shared.end_us) time.end_us = shared.end_us;
    if (time.start_us < shared.start_us) time.start_us = shared.start_us;
    return time;
}

/* A contact that ends before it starts is unresolved during the whole shared time, so that one pair that went wrong does not
 * take away the answers of the others. NaN is in no order. */
static void put_ordered(const KernelTouching *contacts, int64_t i, const KernelMerged *to) {
    Time shared = {contacts->shared_start_us[i], contacts->shared_end_us[i]}, time = shared;
    bool is_ordered = contacts->start_s[i] <= contacts->end_s[i] && contacts->error_s[i] >= 0.0;
    is_ordered = is_ordered && shared.start_us <= shared.end_us;
    if (is_ordered) time = instants_of(contacts->start_s[i], contacts->end_s[i], shared);
    if (!is_ordered || time.start_us > time.end_us) {
        if (shared.start_us > shared.end_us) shared = (Time){shared.end_us, shared.start_us};
        contacts->start_s[i] = 0.0, contacts->end_s[i] = INFINITY;
        contacts->error_s[i] = is_endless(shared) ? 0.0 : us_between(shared.start_us, shared.end_us) / 1e6;
        contacts->verdict[i] = KERNEL_UNRESOLVED, contacts->touches[i] = 1;
        time = shared;
    }
    to->start_us[i] = time.start_us, to->end_us[i] = time.end_us;
}

/* How much longer than the contact a period may be at either end, seconds. Contact is certain from the first to the last
 * certain instant of the contacts merged into it; an uncertain contact leaves the end to its neighbours. */
static double error_of(const Reported *order, const Period *period, const double *error_s) {
    double lead = INFINITY, tail = INFINITY, length = INFINITY;
    Time whole = period->time;
    if (!is_endless(whole)) length = us_between(whole.start_us, whole.end_us) / 1e6;
    for (int64_t k = period->first; k < period->end; k++) {
        Time own = order[k].time;
        double error = error_s[order[k].row], lasts = is_endless(own) ? INFINITY : us_between(own.start_us, own.end_us) / 1e6;
        /* The error of a contact that is its whole period is known, even if the contact is uncertain. */
        if (!(lasts > 2.0 * error) && period->end - period->first > 1) continue;
        /* Finite instants are infinitely far from an end at infinity. */
        double before = whole.start_us == KERNEL_MINUS_INFINITY_US ? INFINITY : us_between(whole.start_us, own.start_us) / 1e6;
        double after = whole.end_us == KERNEL_INFINITY_US ? INFINITY : us_between(own.end_us, whole.end_us) / 1e6;
        if (own.start_us == whole.start_us) before = 0.0;
        if (own.end_us == whole.end_us) after = 0.0;
        lead = least(lead, before + error), tail = least(tail, after + error);
    }
    return least(most(lead, tail), length);
}

/* Put the periods of a group, whose contacts are [first, end) of the order. Returns how many periods there are then. */
static int64_t put_periods(const Reported *order, int64_t first, int64_t end, const double *error_s, int64_t group,
                           int64_t count, const KernelMerged *to) {
    to->time_error_s[group] = 0.0;
    for (int64_t k = first; k < end;) {
        Period period = {order[k].time, k, k + 1};
        for (k++; k < end && order[k].time.start_us <= period.time.end_us; k++) {
            if (order[k].time.end_us > period.time.end_us) period.time.end_us = order[k].time.end_us;
            period.end = k + 1;
        }
        to->period_us[2 * count] = period.time.start_us, to->period_us[2 * count + 1] = period.time.end_us, count++;
        to->time_error_s[group] = most(to->time_error_s[group], error_of(order, &period, error_s));
    }
    return count;
}

/* The verdict of reported contacts. */
static void put_verdict(const KernelTouching *contacts, const Reported *order, int64_t first, int64_t end, int64_t group,
                        const KernelMerged *to) {
    bool has_conflict = false, has_open = false;
    for (int64_t k = first; k < end; k++) {
        has_conflict |= contacts->verdict[order[k].row] == KERNEL_CONFLICT;
        has_open |= contacts->verdict[order[k].row] == KERNEL_UNRESOLVED;
    }
    to->is_open[group] = has_open;
    to->verdict[group] = (int8_t)(has_conflict ? KERNEL_CONFLICT : has_open ? KERNEL_UNRESOLVED : KERNEL_GRAZING);
}

/* How many seconds of the separation in time are lacking: the most of the uses. */
static void put_lacking(const KernelTouching *contacts, const KernelMerged *to) {
    for (int64_t g = 0; g < contacts->groups; g++) to->lacking_s[g] = -1.0, to->lacking_error_s[g] = 0.0;
    for (int64_t i = 0; i < contacts->count; i++) {
        int64_t g = contacts->group[i];
        double lacking = contacts->lacking_s[i];
        if (isnan(lacking) || !(contacts->touches[i] || !to->meets[g])) continue;
        to->lacking_s[g] = most(to->lacking_s[g], lacking);
        to->lacking_error_s[g] = most(to->lacking_error_s[g], lacking - contacts->lacking_error_s[i]);
    }
    for (int64_t g = 0; g < contacts->groups; g++) {
        bool is_known = to->lacking_s[g] >= 0.0;
        to->lacking_error_s[g] = is_known ? to->lacking_s[g] - least(to->lacking_error_s[g], to->lacking_s[g]) : 0.0;
        if (!is_known) to->lacking_s[g] = NAN;
    }
}

static KernelStatus check(const KernelTouching *contacts, const KernelMerged *to) {
    if (!contacts || !to) return KERNEL_NULL;
    if (contacts->count < 0 || contacts->groups < 0) return KERNEL_BAD_COUNT;
    if (contacts->count > INT64_MAX / (int64_t)sizeof(Reported)) return KERNEL_BAD_COUNT;
    bool is_given = contacts->group && contacts->shared_start_us && contacts->shared_end_us && contacts->start_s &&
                    contacts->end_s && contacts->error_s && contacts->verdict && contacts->touches;
    bool has_room = to->start_us && to->end_us && to->order && to->period_us;
    if (contacts->count > 0 && !(is_given && has_room)) return KERNEL_NULL;
    if (!to->order_offset || !to->period_offset) return KERNEL_NULL;
    if (contacts->groups > 0 && !(to->time_error_s && to->verdict && to->is_open && to->meets)) return KERNEL_NULL;
    if (contacts->lacking_s && !(contacts->lacking_error_s && to->lacking_s && to->lacking_error_s)) return KERNEL_NULL;
    for (int64_t i = 0; i < contacts->count; i++)
        if (contacts->group[i] < 0 || contacts->group[i] >= contacts->groups) return KERNEL_BAD_PIECE;
    return KERNEL_OK;
}

KernelStatus kernel_merge(const KernelTouching *contacts, const KernelMerged *to) {
    KernelStatus status = check(contacts, to);
    if (status != KERNEL_OK) return status;
    Reported *order = malloc(((size_t)contacts->count + 1) * sizeof *order);
    if (!order) return KERNEL_NO_MEMORY;
    for (int64_t g = 0; g < contacts->groups; g++) to->meets[g] = 0;
    for (int64_t i = 0; i < contacts->count; i++) {
        put_ordered(contacts, i, to);
        if (contacts->touches[i]) to->meets[contacts->group[i]] = 1;
    }
    /* The periods of objects that meet exclude times at which other pieces of theirs only come close. */
    int64_t count = 0, periods = 0, first = 0;
    for (int64_t i = 0; i < contacts->count; i++) {
        int64_t g = contacts->group[i];
        if (contacts->touches[i] || !to->meets[g] || contacts->verdict[i] == KERNEL_UNRESOLVED)
            order[count++] = (Reported){g, i, {to->start_us[i], to->end_us[i]}};
    }
    qsort(order, (size_t)count, sizeof *order, by_group_and_time);
    to->order_offset[0] = to->period_offset[0] = 0;
    for (int64_t g = 0; g < contacts->groups; g++) {
        int64_t end = first;
        while (end < count && order[end].group == g) to->order[end] = order[end].row, end++;
        put_verdict(contacts, order, first, end, g, to);
        periods = put_periods(order, first, end, contacts->error_s, g, periods, to);
        to->order_offset[g + 1] = first = end, to->period_offset[g + 1] = periods;
    }
    if (contacts->lacking_s) put_lacking(contacts, to);
    free(order);
    return KERNEL_OK;
}
