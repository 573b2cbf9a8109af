"""The stages on Apache Spark with Apache Sedona, for scenes that outgrow one machine (extra `spark`).

Only what Spark hands to its workers as Arrow batches is here: pieces, pairs and answers are made by the functions that
`detect` and `solve` use. Nothing is imported before it is asked for.
"""
