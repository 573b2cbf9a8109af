"""Which plans interfere, where, and exactly when: inside PostGIS."""
