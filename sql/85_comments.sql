-- What the tables and columns mean. Units: metres, degrees; heights above mean sea level.

COMMENT ON SCHEMA conflictdb IS 'Finds when and where moving areas interfere: scenes, areas, tracks and their conflicts.';
