"""Where new records come from: a folder into which files are written, or an MQTT broker, whose messages are kept first.

`FolderSource` offers files once they are whole; `MqttInbox` writes messages to a folder before it confirms them.
Takes nothing of the other rooms.
"""
