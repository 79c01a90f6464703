"""From cameras, files and topics to bursts of frames."""
