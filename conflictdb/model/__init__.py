"""What users hand in and get back: scenes, plans, conflicts."""
