/* Join rows whose bounding boxes overlap in space, height and time, in place of the database's index (stage 1).
 *
 * `kernel_box_order` sorts rows into a packed k-d tree: each half of the order is split along the axis (x, y, time or
 * height) that separates its boxes best. `kernel_box_pairs` builds the bounding boxes of that tree, and looks up each
 * row from the top. A KernelBoxTree keeps rows and bounding boxes for lookups of rows that come later.
 */
#include <math.h>
#include <stdlib.h>

#include "broad/may_meet.h"
#include "kernel.h"
#include "planes/plane.h"

/* Most rows of a leaf. Larger: more rows compared in vain. Smaller: more tree nodes to inspect. */
enum { LEAF = 8, AXES = 4 };

typedef struct {
    double middle[AXES], extent[AXES];
    int64_t row;
} Centre;

static double finite_or_zero(double x) { return isfinite(x) ? x : 0.0; }

static Centre centre_of(const KernelBoxes *rows, int64_t i) {
    const double *box = rows->boxes + 4 * i, start = (double)rows->start_us[i], end = (double)rows->end_us[i];
    double floor_m = rows->floor_m[i], ceiling_m = rows->ceiling_m[i];
    return (Centre){
        .middle = {finite_or_zero(0.5 * box[0] + 0.5 * box[2]), finite_or_zero(0.5 * box[1] + 0.5 * box[3]),
                   0.5 * start + 0.5 * end, finite_or_zero(0.5 * floor_m + 0.5 * ceiling_m)},
        /* Unbounded heights are infinite: that axis separates nothing. */
        .extent = {finite_or_zero(box[2] - box[0]), finite_or_zero(box[3] - box[1]), end - start, ceiling_m - floor_m},
        .row = i,
    };
}

/* The axis along which the spread of the centres is the largest multiple of the mean extent; -1 if all centres are
 * equal. */
static int best_axis(const Centre *centres, int64_t count) {
    int best = -1;
    double most_boxes = 0.0;
    for (int axis = 0; axis < AXES; axis++) {
        double low = INFINITY, high = -INFINITY, extent = 0.0;
        for (int64_t i = 0; i < count; i++) {
            low = least(low, centres[i].middle[axis]), high = most(high, centres[i].middle[axis]);
            extent += centres[i].extent[axis];
        }
        double boxes = (high - low) / most(extent / (double)count, 1e-300);
        if (boxes > most_boxes) best = axis, most_boxes = boxes;
    }
    return best;
}

/* Move the `middle` smallest centres along an axis to the front (Hoare's selection). */
static void select_middle(Centre *centres, int64_t count, int64_t middle, int axis) {
    int64_t low = 0, high = count - 1;
    while (low < high) {
        double pivot = centres[low + (high - low) / 2].middle[axis];
        int64_t i = low, j = high;
        while (i <= j) {
            while (centres[i].middle[axis] < pivot) i++;
            while (centres[j].middle[axis] > pivot) j--;
            if (i > j) break;
            Centre swapped = centres[i];
            centres[i++] = centres[j], centres[j--] = swapped;
        }
        if (middle <= j) high = j;
        else if (middle >= i) low = i;
        else return;
    }
}

static void order_halves(Centre *centres, int64_t count) {
    if (count <= LEAF) return;
    int axis = best_axis(centres, count);
    if (axis < 0) return;
    int64_t middle = count / 2;
    select_middle(centres, count, middle, axis);
    order_halves(centres, middle);
    order_halves(centres + middle, count - middle);
}

static KernelStatus check_boxes(const KernelBoxes *rows) {
    if (!rows) return KERNEL_NULL;
    if (rows->count < 0) return KERNEL_BAD_COUNT;
    bool is_whole = rows->boxes && rows->floor_m && rows->ceiling_m && rows->start_us && rows->end_us;
    return rows->count == 0 || (is_whole && rows->object && rows->is_copy) ? KERNEL_OK : KERNEL_NULL;
}

KernelStatus check_compared(const KernelBoxes *rows, const KernelCompared *compared) {
    if (!rows || !compared) return KERNEL_NULL;
    if (rows->count < 0 || compared->within_us < 0 || compared->type_count < 0) return KERNEL_BAD_COUNT;
    bool is_whole = rows->floor_m && rows->ceiling_m && rows->start_us && rows->end_us && rows->is_copy;
    if (rows->count > 0 && (!is_whole || (compared->of_types && !rows->type))) return KERNEL_NULL;
    for (int64_t i = 0; compared->of_types && i < rows->count; i++)
        if (rows->type[i] < 0 || rows->type[i] >= compared->type_count) return KERNEL_BAD_PIECE;
    return KERNEL_OK;
}

KernelStatus kernel_may_meet(const KernelBoxes *rows, const KernelBoxes *others, const KernelCompared *compared,
                             const int64_t *a, const int64_t *b, int64_t count, uint8_t *met) {
    KernelStatus status = check_compared(rows, compared);
    if (status == KERNEL_OK) status = check_compared(others, compared);
    if (status != KERNEL_OK) return status;
    if (count < 0) return KERNEL_BAD_COUNT;
    if (count > 0 && (!a || !b || !met)) return KERNEL_NULL;
    for (int64_t k = 0; k < count; k++)
        if (a[k] < 0 || a[k] >= rows->count || b[k] < 0 || b[k] >= others->count) return KERNEL_BAD_PIECE;
    for (int64_t k = 0; k < count; k++) met[k] = may_meet(row_of(rows, a[k]), row_of(others, b[k]), compared);
    return KERNEL_OK;
}

KernelStatus kernel_box_order(const KernelBoxes *rows, int64_t *order) {
    KernelStatus status = check_boxes(rows);
    if (status != KERNEL_OK || rows->count == 0) return status;
    if (!order) return KERNEL_NULL;
    Centre *centres = malloc((size_t)rows->count * sizeof *centres);
    if (!centres) return KERNEL_NO_MEMORY;
    for (int64_t i = 0; i < rows->count; i++) centres[i] = centre_of(rows, i);
    order_halves(centres, rows->count);
    for (int64_t i = 0; i < rows->count; i++) order[i] = centres[i].row;
    free(centres);
    return KERNEL_OK;
}

/* Tree node: bounds of the rows [first, end). next: the node after its subtree. */
typedef struct {
    double box[4], floor_m, ceiling_m;
    Span span;
    int64_t object; /* largest number of an object */
    int64_t first, end, next;
    bool is_copy; /* whether all rows are copies */
} Node;

static Node alone(const KernelBoxes *rows, int64_t i) {
    const double *box = rows->boxes + 4 * i;
    return (Node){
        .box = {box[0], box[1], box[2], box[3]},
        .floor_m = rows->floor_m[i],
        .ceiling_m = rows->ceiling_m[i],
        .span = {rows->start_us[i], rows->end_us[i], true},
        .object = rows->object[i],
        .first = i,
        .end = i + 1,
        .next = 0,
        .is_copy = rows->is_copy[i] != 0,
    };
}

/* Union of two nodes. fmin and fmax skip NaN: a row of NaN intersects nothing, and leaves the bounds of its node valid.
 */
static Node joined(Node a, Node b) {
    return (Node){
        .box = {fmin(a.box[0], b.box[0]), fmin(a.box[1], b.box[1]), fmax(a.box[2], b.box[2]), fmax(a.box[3], b.box[3])},
        .floor_m = fmin(a.floor_m, b.floor_m),
        .ceiling_m = fmax(a.ceiling_m, b.ceiling_m),
        .span = {a.span.start_us < b.span.start_us ? a.span.start_us : b.span.start_us,
                 a.span.end_us > b.span.end_us ? a.span.end_us : b.span.end_us, true},
        .object = a.object > b.object ? a.object : b.object,
        .first = a.first,
        .end = b.end,
        .next = 0,
        .is_copy = a.is_copy && b.is_copy,
    };
}

/* Leaves hold at least LEAF / 2 rows, unless there is one leaf only; inner nodes are fewer than leaves. */
static size_t most_nodes(int64_t count) { return (size_t)(4 * count / LEAF + 2); }

/* Build the subtree of rows [first, end) at node `at`, each node before its children; returns the number after its last
 * node. */
static int64_t make_nodes(const KernelBoxes *rows, Node *nodes, int64_t at, int64_t first, int64_t end) {
    int64_t next = at + 1;
    if (end - first <= LEAF) {
        Node whole = alone(rows, first);
        for (int64_t i = first + 1; i < end; i++) whole = joined(whole, alone(rows, i));
        nodes[at] = whole;
    } else {
        int64_t middle = first + (end - first) / 2, right = make_nodes(rows, nodes, next, first, middle);
        next = make_nodes(rows, nodes, right, middle, end);
        nodes[at] = joined(nodes[at + 1], nodes[right]);
    }
    nodes[at].next = next;
    return next;
}

/* The rows of a node as one, which meets whatever one of them meets. */
static Row row_of_node(const Node *node) {
    return (Row){node->box, node->floor_m, node->ceiling_m, node->span, node->is_copy, NULL, 0};
}

/* Nodes contain rows of all types. */
static KernelCompared of_nodes(const KernelCompared *compared) { return (KernelCompared){compared->within_us, 0, NULL}; }

KernelStatus kernel_box_pairs(const KernelBoxes *rows, const KernelCompared *compared, const int64_t *of, int64_t wanted,
                              int64_t *first, int64_t *second, int64_t room, int64_t *done, int64_t *found,
                              int64_t *looked_at) {
    KernelStatus status = check_boxes(rows);
    if (status == KERNEL_OK) status = check_compared(rows, compared);
    if (status != KERNEL_OK) return status;
    if (!done || !found || !looked_at || (wanted > 0 && !of) || (room > 0 && (!first || !second))) return KERNEL_NULL;
    if (wanted < 0 || room < 0) return KERNEL_BAD_COUNT;
    for (int64_t k = 0; k < wanted; k++)
        if (of[k] < 0 || of[k] >= rows->count) return KERNEL_BAD_PIECE;
    Node *nodes = malloc(most_nodes(rows->count) * sizeof *nodes);
    if (!nodes) return KERNEL_NO_MEMORY;
    int64_t count = rows->count > 0 ? make_nodes(rows, nodes, 0, 0, rows->count) : 0, pairs = 0;
    const KernelCompared nodes_compared = of_nodes(compared);
    *done = *found = *looked_at = 0;
    for (int64_t k = 0; k < wanted; k++) {
        const Row row = row_of(rows, of[k]);
        const int64_t object = rows->object[of[k]];
        if (k > 0 && rows->object[of[k - 1]] != object) *done = k, *found = pairs;
        for (int64_t n = 0; n < count;) {
            const Node *node = nodes + n;
            ++*looked_at;
            if (object >= node->object || !may_meet(row, row_of_node(node), &nodes_compared)) {
                n = node->next;
                continue;
            }
            n++;
            if (node->next > n) continue;
            *looked_at += node->end - node->first;
            for (int64_t j = node->first; j < node->end; j++) {
                if (object >= rows->object[j] || !may_meet(row, row_of(rows, j), compared)) continue;
                if (pairs == room) {
                    free(nodes);
                    return KERNEL_OK;
                }
                first[pairs] = of[k], second[pairs++] = j;
            }
        }
    }
    *done = wanted, *found = pairs;
    free(nodes);
    return KERNEL_OK;
}

/* Rows in the order of kernel_box_order, their given numbers, and the nodes above them; one block of memory. */
struct KernelBoxTree {
    KernelBoxes rows;
    const int64_t *number;
    const Node *nodes;
    int64_t node_count;
};

KernelStatus kernel_box_tree_make(const KernelBoxes *rows, KernelBoxTree **tree) {
    KernelStatus status = check_boxes(rows);
    if (status != KERNEL_OK) return status;
    if (!tree) return KERNEL_NULL;
    size_t n = (size_t)rows->count;
    size_t row_size = 6 * sizeof(double) + (5 + KERNEL_NUMBERS) * sizeof(int64_t) + 2 * sizeof(uint8_t);
    char *block = malloc(sizeof(KernelBoxTree) + most_nodes(rows->count) * sizeof(Node) + n * row_size);
    if (!block) return KERNEL_NO_MEMORY;
    KernelBoxTree *made = (KernelBoxTree *)block;
    Node *nodes = (Node *)(made + 1);
    double *boxes = (double *)(nodes + most_nodes(rows->count)), *floor_m = boxes + 4 * n, *ceiling_m = floor_m + n;
    int64_t *start_us = (int64_t *)(ceiling_m + n), *end_us = start_us + n, *object = end_us + n, *number = object + n;
    int64_t *numbers = number + n, *type = numbers + KERNEL_NUMBERS * n;
    uint8_t *is_copy = (uint8_t *)(type + n), *end_inclusive = is_copy + n;
    status = kernel_box_order(rows, number);
    if (status != KERNEL_OK) {
        free(block);
        return status;
    }
    for (size_t k = 0; k < n; k++) {
        int64_t i = number[k];
        for (int c = 0; c < 4; c++) boxes[4 * k + (size_t)c] = rows->boxes[4 * i + c];
        floor_m[k] = rows->floor_m[i], ceiling_m[k] = rows->ceiling_m[i];
        start_us[k] = rows->start_us[i], end_us[k] = rows->end_us[i];
        object[k] = rows->object[i], is_copy[k] = rows->is_copy[i];
        type[k] = rows->type ? rows->type[i] : 0;
        for (int64_t c = 0; rows->numbers && c < KERNEL_NUMBERS; c++)
            numbers[KERNEL_NUMBERS * k + (size_t)c] = rows->numbers[KERNEL_NUMBERS * i + c];
        end_inclusive[k] = !rows->end_inclusive || rows->end_inclusive[i];
    }
    *made = (KernelBoxTree){
        .rows = {rows->count, boxes, floor_m, ceiling_m, start_us, end_us, object, is_copy, end_inclusive,
                 rows->numbers ? numbers : NULL, type},
        .number = number,
        .nodes = nodes,
    };
    made->node_count = n ? make_nodes(&made->rows, nodes, 0, 0, rows->count) : 0;
    *tree = made;
    return KERNEL_OK;
}

void kernel_box_tree_free(KernelBoxTree *tree) { free(tree); }

KernelStatus kernel_box_tree_pairs(const KernelBoxTree *tree, const KernelBoxes *rows, const KernelCompared *compared,
                                   int64_t *first, int64_t *second, int64_t room, int64_t *found) {
    if (!tree) return KERNEL_NULL;
    KernelStatus status = check_boxes(rows);
    if (status == KERNEL_OK) status = check_compared(rows, compared);
    if (status == KERNEL_OK) status = check_compared(&tree->rows, compared);
    if (status != KERNEL_OK) return status;
    if (!found || (room > 0 && (!first || !second))) return KERNEL_NULL;
    if (room < 0) return KERNEL_BAD_COUNT;
    const KernelCompared nodes_compared = of_nodes(compared);
    int64_t pairs = 0;
    for (int64_t i = 0; i < rows->count; i++) {
        const Row row = row_of(rows, i);
        for (int64_t n = 0; n < tree->node_count;) {
            const Node *node = tree->nodes + n;
            if (!may_meet(row, row_of_node(node), &nodes_compared)) {
                n = node->next;
                continue;
            }
            n++;
            if (node->next > n) continue;
            for (int64_t j = node->first; j < node->end; j++) {
                if (!may_meet(row, row_of(&tree->rows, j), compared)) continue;
                if (pairs < room) first[pairs] = i, second[pairs] = tree->number[j];
                pairs++;
            }
        }
    }
    *found = pairs;
    return KERNEL_OK;
}
