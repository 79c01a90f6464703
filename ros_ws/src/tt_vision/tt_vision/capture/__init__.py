"""From cameras, files and topics to bursts.

A burst holds the images of one ball's passage through the high speed cameras (about six pairs).
"""
