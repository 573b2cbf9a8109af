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

CREATE OR REPLACE FUNCTION conflictdb_internal._hulls_meet(
    p_a geometry, p_b geometry, p_padding_m double precision DEFAULT 0
) RETURNS boolean
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    -- A distance of a micrometre, not ST_Intersects: apart.c also keeps pairs whose gap is within its rounding error,
    -- at most 0.1 um, and they may be reported as grazing.
    SELECT ST_DWithin(p_a, p_b, 1e-6 + p_padding_m);
END;
COMMENT ON FUNCTION _hulls_meet(geometry, geometry, double precision) IS
'Stage 2 of two pieces: whether their hulls (metres of the plane) meet, or are at most a micrometre apart. Rough '
'pieces have shapes and a padding instead. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._areas_overlap(
    p_a geometry, p_b geometry, p_by_m double precision
) RETURNS boolean
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_Intersects(p_a, p_b) AND NOT ST_IsEmpty(ST_Buffer(ST_Intersection(p_a, p_b), -p_by_m));
END;
COMMENT ON FUNCTION _areas_overlap(geometry, geometry, double precision) IS
'Stage 2 of two areas: whether a disc of a radius (metres of the plane) fits into what their shapes share. Deeper than '
'the tolerance they are in conflict while both are there.';
