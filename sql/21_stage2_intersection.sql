-- Stage 2 (intersection): candidate pairs whose hulls meet while both pieces exist. Runs here where few pieces are
-- involved: detection of few changes, probes, candidates() and explain_conflict. Whole scenes compare hulls at the
-- client (conflictdb/kernel/broad/apart.c), in a tenth of the time.

CREATE OR REPLACE FUNCTION conflictdb_internal._boxes_meet(p_a geometry, p_b geometry) RETURNS boolean
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    -- && compares boxes that are rounded outward, by up to a metre.
    SELECT ST_XMin(p_a) <= ST_XMax(p_b) AND ST_XMin(p_b) <= ST_XMax(p_a)
           AND ST_YMin(p_a) <= ST_YMax(p_b) AND ST_YMin(p_b) <= ST_YMax(p_a);
END;
COMMENT ON FUNCTION _boxes_meet(geometry, geometry) IS
'Stage 1 of two pieces: whether the boxes of their hulls overlap, exactly as the client compares them. Inlined into '
'queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._hulls_meet(p_a geometry, p_b geometry) RETURNS boolean
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    -- A distance of a micrometre, not ST_Intersects: apart.c also keeps pairs whose gap is within its rounding error,
    -- at most 0.1 um, and they may be reported as grazing.
    SELECT ST_DWithin(p_a, p_b, 1e-6);
END;
COMMENT ON FUNCTION _hulls_meet(geometry, geometry) IS
'Stage 2 of two pieces: whether their hulls (metres of the plane) meet, or are at most a micrometre apart. Inlined '
'into queries.';
