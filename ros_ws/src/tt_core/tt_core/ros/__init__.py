"""The only code that knows messages, parameters, quality of service and executors; written once, used by every node."""
